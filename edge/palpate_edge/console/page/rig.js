// The page of a press-rig run.
import { byId, command, drawn, figures, follow, History, number, prepareButtons } from "/console.js";
import { drawBeads, Pictures } from "/beads.js";

const PROGRAM = "palpate-edge press-rig";
const NEAR = 1.5; // distance of the ball from the dome's centre that is drawn, in distances at touch

const force = new History(byId("force"), ["force on the scale"], ["#ff9d4d"], "N");
const pictures = new Pictures(byId("camera"), (frame, pen, scale) => {
  byId("camera").dataset.sequence = frame.sequence;
  byId("camera").dataset.beads = frame.beads.position_px.length;
  drawBeads(pen, frame.beads, scale);
});
let presses = [];

follow({ frame: (frame) => pictures.show(frame), rig: showRun, presses: (value) => { presses = value; } }, PROGRAM);
prepareButtons(PROGRAM);
byId("stop").addEventListener("click", () => command({ command: "stop" }));

function showRun(run) {
  byId("progress").max = run.total;
  byId("progress").value = run.done;
  byId("text").textContent = run.text;
  figures(byId("figures"), [
    ["frames taken", `${run.done} of ${run.total}`],
    ["force on the scale", number(run.force_N, 2, "N")],
    ["ball from the centre", run.ball_mm ? `${run.ball_mm.map((value) => value.toFixed(1)).join(", ")} mm` : "–"],
  ]);
  force.add([run.force_N]);
  force.draw();
  drawTop(run);
}

/** The unit sphere of normals from the top, x to the right and y up. */
function drawTop(run) {
  const dots = presses.map(({ outward: [x, y], weight_N }) =>
    drawn("circle", { cx: x, cy: -y, r: 0.015 + 0.01 * Math.min(4, Math.max(0, weight_N)), class: "contact" }));
  byId("top").replaceChildren(drawn("circle", { cx: 0, cy: 0, r: 1, class: "rim" }), ...dots);
  byId("top").dataset.presses = presses.length;
  if (!run.ball_mm) return;
  const [x, y, z] = run.ball_mm.map((value) => value / run.reach_mm);
  if (Math.hypot(x, y, z) < NEAR) byId("top").append(drawn("circle", { cx: x, cy: -y, r: 0.05, class: "ball" }));
}
