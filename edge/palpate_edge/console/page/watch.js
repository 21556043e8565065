// The console of one fingertip.
import { arrow, byId, command, drawn, figures, follow, healthTable, History, number, prepareButtons } from "/console.js";
import { drawBeads, Pictures } from "/beads.js";
import { prepareGuide, showGuide } from "/guide.js";

const PROGRAM = "palpate-edge watch";
const MM_PER_N = 6, LONGEST_MM = 40; // of the force's arrow
const OLD_MS = 1000; // a picture older than this is marked

const force = new History(byId("force"), ["normal force", "shear"], ["#ff9d4d", "#b48cff"], "N");
let fingertip = { outer_radius_mm: null };
let shownAt = 0, arrivals = [];
let isRecording = false, levelTouchedAt = 0;

follow({ fingertip: showFingertip, frame: (frame) => pictures.show(frame), health: showHealth, guide: showGuide }, PROGRAM);
prepareButtons(PROGRAM);
prepareGuide();
byId("tunnel").textContent = `ssh -L ${location.port}:127.0.0.1:${location.port} USER@BOARD`;

for (const button of document.querySelectorAll("[data-command]")) {
  button.addEventListener("click", () => command({ command: button.dataset.command }));
}
byId("record").addEventListener("click", () => command({ command: isRecording ? "record_no_more" : "record" }));
byId("level").addEventListener("input", (event) => {
  levelTouchedAt = performance.now();
  byId("level-text").textContent = event.target.value;
});
byId("level").addEventListener("change", (event) => command({ command: "light", level: Number(event.target.value) }));

function showFingertip(value) {
  fingertip = value;
  document.title = `${value.name} - palpate`;
  byId("name").textContent = value.name;
  drawDome(null);
}

function showHealth(health) {
  isRecording = health.recording !== "";
  byId("record").textContent = isRecording ? "Stop recording" : "Record";
  byId("record").className = isRecording ? "command on" : "command";
  const light = health.light;
  if (light && performance.now() - levelTouchedAt > 3000 && document.activeElement !== byId("level")) {
    byId("level").value = light.level;
    byId("level-text").textContent = light.level;
  }
  figures(byId("state"), [
    ["camera", number(health.fps, 1, "frames/s")],
    ["dropped", String(health.dropped)],
    ["bus state", health.nmt_state || "no daemon"],
    ["silicone", number(light && light.silicone_degC, 1, "°C")],
    ["LED", number(light && light.led_degC, 1, "°C")],
    ["recording", health.recording || "no"],
  ]);
  healthTable(byId("health"), health.rows);
}

const pictures = new Pictures(byId("camera"), (frame, pen, scale) => {
  byId("camera").dataset.sequence = frame.contact.sequence;
  if (frame.beads) drawBeads(pen, frame.beads, scale);
  const now = performance.now();
  shownAt = now;
  arrivals = [...arrivals.filter((at) => at > now - 2000), now];
  showContact(frame);
});

const norm = (vector) => vector && Math.hypot(...vector);

function shearOf(contact) {
  if (!contact.position_mm || !contact.force_N) return contact.in_contact ? null : 0;
  const length = norm(contact.position_mm), normal = contact.position_mm.map((value) => value / length);
  const along = normal.reduce((sum, value, axis) => sum + value * contact.force_N[axis], 0);
  return norm(contact.force_N.map((value, axis) => value - along * normal[axis]));
}

function showContact(frame) {
  const contact = frame.contact, place = contact.position_mm;
  const shear = contact.valid ? shearOf(contact) : null;
  const text = !contact.valid ? contact.reason : !contact.in_contact ? "none" : contact.slip ? "slips" : "yes";
  const pose = contact.pose.map((one) => [one.label, `${one.value.toFixed(2)} ± ${one.half_width95.toFixed(2)}`]);
  figures(byId("picture"), [
    ["pictures shown", `${(arrivals.length / 2).toFixed(1)} /s`],
    ["latency of the estimate", number(frame.latency_ms, 1, "ms")],
    ["beads", contact.beads_expected ? `${contact.beads_found} of ${contact.beads_expected}` : `${contact.beads_found}`],
    ["frame", String(contact.sequence)],
  ]);
  figures(byId("contact"), [
    ["contact", text],
    ["position", place ? `${place.map((value) => value.toFixed(1)).join(", ")} mm` : "–"],
    ["95 % radius", number(contact.radius95_mm, 2, "mm")],
    ["normal force", number(contact.normal_force_N, 2, "N")],
    ["shear", number(shear, 2, "N")],
    ["torsion", number(contact.torsion_Nmm, 1, "N mm")],
    ...pose,
  ]);
  force.add([contact.valid ? contact.normal_force_N : null, shear]);
  force.draw();
  drawDome(contact.valid && contact.in_contact ? contact : null);
}

/** The dome in its frame F: side view x to the right, z up; top view x to the right, y up. */
function drawDome(contact) {
  const radius = fingertip.outer_radius_mm || 30, side = byId("side"), top = byId("top");
  const known = fingertip.outer_radius_mm ? "" : "the dome's size is not known";
  side.replaceChildren(
    drawn("path", { d: `M ${-radius} 0 A ${radius} ${radius} 0 0 1 ${radius} 0 Z`, class: "skin" }),
    drawn("line", { x1: -40, y1: 0, x2: 40, y2: 0, class: "base" }),
    drawn("text", { x: -40, y: 15 }, "x →, z ↑"), drawn("text", { x: -40, y: 9 }, known));
  top.replaceChildren(
    drawn("circle", { cx: 0, cy: 0, r: radius, class: "skin" }), drawn("text", { x: -40, y: 40 }, "x →, y ↑"));
  if (!contact || !contact.position_mm) return;
  for (const [view, up] of [[side, 2], [top, 1]]) {
    const at = (vector) => [vector[0], -vector[up]];
    const [x, y] = at(contact.position_mm);
    if (contact.radius95_mm) view.append(drawn("circle", { cx: x, cy: y, r: contact.radius95_mm, class: "radius95" }));
    if (contact.force_N) {
      const scale = Math.min(MM_PER_N, LONGEST_MM / Math.max(1e-9, norm(contact.force_N)));
      const from = contact.position_mm.map((value, axis) => value - scale * contact.force_N[axis]);
      view.append(...arrow(at(from), [x, y]));
    }
    view.append(drawn("circle", { cx: x, cy: y, r: 1.6, class: contact.slip ? "slip" : "contact" }));
  }
}

setInterval(() => {
  const age = performance.now() - shownAt;
  byId("camera").style.opacity = age > OLD_MS ? 0.4 : 1;
  if (age > OLD_MS && shownAt) figures(byId("picture"), [["no picture for", `${(age / 1000).toFixed(1)} s`]]);
}, 250);
