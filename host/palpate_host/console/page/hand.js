// The console of a hand.
import { byId, command, figures, follow, History, made, mayCommand, number, prepareButtons } from "/console.js";

const PROGRAM = "palpate-host console";
const M_PER_N = 0.01;
const COLOURS = ["#5aa9ff", "#4cc38a", "#f5c451", "#b48cff", "#ff8fb1"];
const view = { yaw: -0.6, pitch: 0.45, scene: null, reach_m: 0 };
let force = null, shown = "";
let gaitFrom = null; // orientation at the begin of a turn by finger gaiting
let lights = [], recordings = { recording: "", playing: "" };

follow({ hand: show, bus: showBus, recordings: showRecordings }, PROGRAM);
prepareButtons(PROGRAM);
byId("tunnel").textContent = `ssh -L ${location.port}:127.0.0.1:${location.port} USER@HOST`;
for (const button of document.querySelectorAll("[data-command]")) {
  button.addEventListener("click", () => command({ command: button.dataset.command }));
}
byId("stop").addEventListener("click", () => command({ command: "stop" }));
const angles = () => ["roll", "pitch", "yaw"].map((axis) => Number(byId(axis).value));
byId("turn").addEventListener("click", () =>
  command({ command: "rotate", rpy_deg: angles(), ramp_s: Number(byId("ramp").value) }));
byId("reorient").addEventListener("click", () =>
  command({ command: "reorient", rpy_deg: angles(), corners_mm: corners(byId("corners").value) }));

/** Rows of numbers, as palpate-host command reorient reads them; a word that is none becomes null and is refused. */
const corners = (text) => text.split("\n")
  .map((line) => line.split("#")[0].split(/[\s,]+/).filter(Boolean).map(Number))
  .filter((row) => row.length);

byId("record").addEventListener("click", () => command({ command: recordings.recording ? "record_no_more" : "record" }));
byId("play").addEventListener("click", () =>
  command(recordings.playing ? { command: "play_no_more" } : { command: "play", name: byId("recording").value }));

function showRecordings(value) {
  recordings = value;
  byId("folder").textContent = value.folder;
  byId("record").textContent = value.recording ? "Stop recording" : "Record";
  byId("record").className = value.recording ? "command on" : "command";
  byId("play").textContent = value.playing ? "Stop playing" : "Play";
  byId("play").className = value.playing ? "command on" : "command";
  byId("play").disabled = !mayCommand || !(value.playing || value.names.length);
  byId("recording-failure").textContent = value.failure;
  const list = byId("recording"), chosen = value.playing || list.value;
  list.replaceChildren(...value.names.map((name) => made("option", name)));
  list.value = value.names.includes(chosen) ? chosen : value.names[0] || "";
  if (!value.playing) byId("shown").textContent = "";
}

function showBus(value) {
  lights = value.fingertips;
  figures(byId("bus"), [
    ["bus load", number(value.load === null ? null : 100 * value.load, 1, "%")],
    ["frames on the bus", number(value.frames_s, 0, "/s")],
  ]);
  byId("bus-failure").textContent = value.failure;
}

function show({ status, scene, recording, at_s }) {
  byId("shown").textContent = recording ? `recording ${recording}, ${at_s.toFixed(1)} s` : "";
  byId("mode").textContent = status.mode;
  byId("mode").className = ["fault", "stop"].includes(status.mode) ? "bad fail" : status.mode === "hold" ? "warn" : "ok";
  byId("reason").textContent = status.reason;
  byId("warning").textContent = [status.warning, status.last_emergency].filter(Boolean).join("; ");
  figures(byId("state"), [
    ["orientation error", number(status.orientation_error_deg, 2, "°")],
    ["target", `${status.target_rpy_deg.map((angle) => angle.toFixed(0)).join(", ")}°`],
    ["turned", `${(100 * status.turned).toFixed(0)} %`],
    ["normals' misfit", number(status.fit_residual_deg, 2, "°")],
    ["ticks", String(status.counters.ticks)],
    ["late ticks", String(status.counters.late_ticks)],
  ]);
  showGait(status);
  if (force === null || shown !== recording) {
    shown = recording;
    force = new History(byId("force"), status.fingers.map((finger) => finger.name), COLOURS, "N");
  }
  force.add(status.fingers.map((finger) => (finger.valid ? finger.normal_force_N : null)));
  force.draw();
  table("finger", ["finger", "contact", "normal force", "shear", "friction ratio", "95 % radius", "age", "frames/s", "lost", "silicone", "LED level"],
    status.fingers.map((finger, index) => [
      finger.name,
      !finger.valid ? "not valid" : !finger.in_contact ? "none" : finger.slip ? "slips" : "yes",
      number(finger.normal_force_N, 2, "N"),
      number(finger.shear_N && Math.hypot(...finger.shear_N), 2, "N"),
      friction(status.hold, index),
      number(finger.radius95_mm, 2, "mm"),
      number(finger.age_ms, 0, "ms"),
      finger.frames_per_s.toFixed(0),
      String(finger.lost_frames),
      ...light(recording ? null : lights[index]),
    ]));
  table("joint", ["joint", "position", "velocity", "torque", "commanded", "drive"],
    status.joints.map((joint) => [
      joint.name,
      number(joint.position_rad === null ? null : joint.position_rad * 180 / Math.PI, 1, "°"),
      number(joint.velocity_rad_s, 2, "rad/s"),
      number(joint.torque_Nm, 3, "N m"),
      number(joint.command_Nm, 3, "N m"),
      joint.drive_state,
    ]));
  view.scene = scene;
  draw();
}

/** Show phase and lifted finger of a turn by finger gaiting, how far it is, and why it was refused or stopped. */
function showGait({ hold, fingers, R_c }) {
  const gait = hold ? hold.gait : "", isOver = ["", "refused", "done", "stopped"].includes(gait);
  if (isOver || gait === "planning") gaitFrom = gait === "planning" ? R_c : gait ? gaitFrom : null;
  byId("gait").className = ["refused", "stopped"].includes(gait) ? "refused" : "";
  byId("gait").textContent = !gait ? "" : [
    `reorient: ${gait}`,
    hold.lifted === null ? "" : `${fingers[hold.lifted].name} is lifted`,
    gaitFrom && R_c && gait !== "planning" && gait !== "refused" ? `${angle(R_c, gaitFrom).toFixed(0)}° turned` : "",
    hold.gait_reason,
  ].filter(Boolean).join(", ");
}

/** Angle between two rotations (3 x 3) in degrees. */
function angle(one, other) {
  const trace = one.flatMap((row, i) => row.map((value, j) => value * other[i][j])).reduce((sum, value) => sum + value, 0);
  return Math.acos(Math.max(-1, Math.min(1, (trace - 1) / 2))) * 180 / Math.PI;
}

/** Texts of a fingertip's temperature and LED level, from the bus; a recording has none. */
const light = (value) => [number(value && value.silicone_degC, 1, "°C"), value ? String(value.led_level) : "–"];

/** Ratio of tangential to normal force, and the estimated friction. */
function friction(hold, index) {
  const ratio = hold && hold.friction_ratio[index];
  return typeof ratio === "number" ? `${ratio.toFixed(2)} of ${hold.friction[index].toFixed(2)}` : "";
}

function table(kind, names, rows) {
  const line = (cells, tag) => {
    const row = document.createElement("tr");
    row.append(...cells.map((text) => made(tag, text)));
    return row;
  };
  byId(`${kind}-head`).replaceChildren(line(names, "th"));
  byId(`${kind}s`).replaceChildren(...rows.map((cells) => line(cells, "td")));
}

/** Orthographic projection of the palm's frame, z up: [x, y] in m on the screen, and the depth. */
function project([x, y, z]) {
  const cos = Math.cos(view.yaw), sin = Math.sin(view.yaw);
  const across = cos * x - sin * y, away = sin * x + cos * y;
  return [across, -(Math.cos(view.pitch) * z + Math.sin(view.pitch) * away), away];
}

function draw() {
  const canvas = byId("scene"), pen = canvas.getContext("2d"), scene = view.scene;
  const width = canvas.width = canvas.clientWidth * devicePixelRatio;
  const height = canvas.height = width * 0.75;
  canvas.dataset.fingers = scene ? scene.fingers.length : 0;
  if (!scene) {
    pen.fillStyle = "#9aa3b2";
    pen.font = `${14 * devicePixelRatio}px system-ui, sans-serif`;
    pen.fillText("a joint's position is not known yet", 20, height / 2);
    return;
  }
  const points = scene.fingers.flatMap((finger) => finger.chain_m);
  const middle = [0, 1, 2].map((axis) =>
    (Math.min(...points.map((point) => point[axis])) + Math.max(...points.map((point) => point[axis]))) / 2);
  const reach = Math.max(...points.map((point) => Math.hypot(...point.map((value, axis) => value - middle[axis]))));
  view.reach_m = Math.max(view.reach_m, reach + 2 * scene.dome_radius_m); // the scale does not shrink again
  const scale = 1.25 * Math.min(width, height) / 2 / view.reach_m; // no view shows the whole reach
  const at = (point) => {
    const [x, y] = project(point.map((value, axis) => value - middle[axis]));
    return [width / 2 + scale * x, height / 2 + scale * y];
  };
  const line = (from, to, colour, thickness) => {
    pen.strokeStyle = colour;
    pen.lineWidth = thickness * devicePixelRatio;
    pen.lineCap = "round";
    pen.beginPath(); pen.moveTo(...at(from)); pen.lineTo(...at(to)); pen.stroke();
  };
  const dot = (point, radius, colour) => {
    pen.fillStyle = colour;
    pen.beginPath(); pen.arc(...at(point), radius, 0, 2 * Math.PI); pen.fill();
  };
  const origin = [0, 0, 0], axes = [[0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]];
  axes.forEach((axis, index) => line(origin, axis, ["#ff6b6b", "#4cc38a", "#5aa9ff"][index], 1.5));
  const roots = scene.fingers.map((finger) => finger.chain_m[0]);
  roots.forEach((root, index) => line(root, roots[(index + 1) % roots.length], "#343944", 2));
  const order = [...scene.fingers.keys()].sort((one, other) => depth(scene, other) - depth(scene, one));
  for (const index of order) {
    const finger = scene.fingers[index], chain = finger.chain_m, colour = COLOURS[index % COLOURS.length];
    chain.slice(1).forEach((point, joint) => line(chain[joint], point, "#8b98a8", 5));
    chain.slice(0, -1).forEach((point) => dot(point, 4 * devicePixelRatio, "#c7d0da"));
    dot(chain.at(-1), scale * scene.dome_radius_m, colour + "44");
    line(chain.at(-1), finger.apex_m, colour, 1.5);
    if (finger.contact_m) {
      if (finger.force_N) {
        const tail = finger.contact_m.map((value, axis) => value - M_PER_N * finger.force_N[axis]);
        line(tail, finger.contact_m, "#ff9d4d", 3);
      }
      dot(finger.contact_m, 4 * devicePixelRatio, "#ff9d4d");
    }
    const [x, y] = at(chain.at(-1));
    pen.fillStyle = colour;
    pen.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    pen.fillText(finger.name, x + 8, y - 8);
  }
}

const depth = (scene, index) => project(scene.fingers[index].chain_m.at(-1))[2];

byId("scene").addEventListener("pointerdown", (event) => event.target.setPointerCapture(event.pointerId));
byId("scene").addEventListener("pointermove", (event) => {
  if (!event.buttons) return;
  view.yaw += event.movementX * 0.01;
  view.pitch = Math.max(-1.57, Math.min(1.57, view.pitch + event.movementY * 0.01));
  draw();
});
