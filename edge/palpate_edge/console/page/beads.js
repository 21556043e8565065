// The camera's picture with its beads.
const ARROW_SCALE = 5; // of displacements in the picture

/** Shows pictures on a canvas; `drawOver` (frame, pen, scale) draws what belongs to one over it. */
export class Pictures {
  constructor(canvas, drawOver) {
    Object.assign(this, { canvas, drawOver, picture: new Image(), waiting: null });
  }

  /** Decode a picture, then paint it together with what belongs to it; a later frame replaces a waiting one. */
  show(frame) {
    const isBusy = this.waiting !== null;
    this.waiting = frame;
    if (!isBusy) this.paintNext();
  }

  async paintNext() {
    while (this.waiting !== null) {
      const frame = this.waiting;
      this.picture.src = `data:image/jpeg;base64,${frame.jpeg}`;
      await this.picture.decode().catch(() => null);
      this.paint(frame);
      if (this.waiting === frame) this.waiting = null;
    }
  }

  paint(frame) {
    const canvas = this.canvas, pen = canvas.getContext("2d"), [width, height] = frame.size_px;
    const scale = Math.max(2, 640 / width);
    canvas.width = width * scale;
    canvas.height = height * scale;
    pen.drawImage(this.picture, 0, 0, canvas.width, canvas.height);
    this.drawOver(frame, pen, scale);
  }
}

/** Circles around beads that were found, crosses where one was lost, arrows of displacements. */
export function drawBeads(pen, beads, scale) {
  const lost = new Set(beads.lost), at = ([x, y]) => [(x + 0.5) * scale, (y + 0.5) * scale];
  const radius = circleRadius(beads.rest_px) * scale;
  pen.lineWidth = 1.5;
  beads.position_px.forEach((place, bead) => {
    const [x, y] = at(place);
    pen.strokeStyle = lost.has(bead) ? "#ff6b6b" : "#50dc3c";
    pen.beginPath();
    if (lost.has(bead)) {
      pen.moveTo(x - 6, y - 6); pen.lineTo(x + 6, y + 6); pen.moveTo(x - 6, y + 6); pen.lineTo(x + 6, y - 6);
    } else pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.stroke();
    const rest = at(beads.rest_px[bead]), dx = ARROW_SCALE * (x - rest[0]), dy = ARROW_SCALE * (y - rest[1]);
    if (!lost.has(bead) && Math.hypot(dx, dy) > 6) {
      const angle = Math.atan2(dy, dx);
      pen.strokeStyle = "#ffdc00";
      pen.beginPath();
      pen.moveTo(rest[0], rest[1]);
      pen.lineTo(rest[0] + dx, rest[1] + dy);
      for (const turn of [-2.6, 2.6]) {
        pen.moveTo(rest[0] + dx, rest[1] + dy);
        pen.lineTo(rest[0] + dx + 6 * Math.cos(angle + turn), rest[1] + dy + 6 * Math.sin(angle + turn));
      }
      pen.stroke();
    }
  });
}

/** A quarter of the usual distance to the nearest bead: circles that do not touch. */
function circleRadius(places) {
  const nearest = places.map((one) => Math.min(...places.map((other) =>
    other === one ? Infinity : Math.hypot(one[0] - other[0], one[1] - other[1]))));
  return Math.min(30, 0.25 * nearest.sort((a, b) => a - b)[nearest.length >> 1]) || 4;
}
