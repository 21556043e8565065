// Shared by both consoles: the stream of events, commands with the token, drawing.

export const byId = (id) => document.getElementById(id);

const SILENT_MS = 900; // the server sends a beat each 0.4 s
const RETRY_MS = 1000;
const token = takeToken();
export const mayCommand = token !== "";

/** The token of the address, kept for this tab and removed from the address bar. */
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem("token", given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("token") || "";
}

/** Follow the stream; handlers: kind -> function of its value. The page shows when the stream is dead. */
export function follow(handlers, program) {
  let heard = performance.now();
  let state = { connected: false, text: "connecting" };
  let alive = false;
  const show = () => {
    const live = alive && state.connected;
    byId("link").dataset.state = live ? "live" : "lost";
    byId("link").textContent = alive ? state.text : `no answer from ${program}: start it again, this page reconnects`;
    document.body.dataset.live = live;
  };
  const hear = () => { heard = performance.now(); if (!alive) { alive = true; show(); } };
  const connect = () => {
    const source = new EventSource("/events");
    source.addEventListener("beat", hear);
    source.addEventListener("state", (event) => { state = JSON.parse(event.data); hear(); show(); });
    for (const [kind, handle] of Object.entries(handlers)) {
      source.addEventListener(kind, (event) => { hear(); handle(JSON.parse(event.data)); });
    }
    source.addEventListener("error", () => {
      alive = false;
      show();
      // After a refusal, as with too many pages, the browser itself does not connect again.
      if (source.readyState === EventSource.CLOSED) setTimeout(connect, RETRY_MS);
    });
  };
  connect();
  setInterval(() => {
    if (alive && performance.now() - heard > SILENT_MS) { alive = false; show(); }
  }, 200);
  show();
}

/** Send a command; show its answer, or why it was refused. */
export async function command(body) {
  const answer = byId("answer");
  try {
    const response = await fetch("/command", {
      method: "POST",
      headers: { "Content-Type": "application/json", "Authorization": `Bearer ${token}` },
      body: JSON.stringify(body),
    });
    const value = await response.json();
    answer.className = response.ok ? "" : "refused";
    answer.textContent = response.ok ? value.text : value.refused;
  } catch {
    answer.className = "refused";
    answer.textContent = "not sent: the console does not answer";
  }
}

/** Enable the buttons for whoever has the token; explain it to the others. */
export function prepareButtons(program) {
  for (const element of document.querySelectorAll("[data-command], .command")) element.disabled = !mayCommand;
  byId("permission").textContent = mayCommand ? "" :
    `Watching only. To command, open the address with #token= that ${program} printed.`;
}

export const number = (value, digits, unit) =>
  value === null || value === undefined ? "–" : `${value.toFixed(digits)} ${unit}`;

/** Show figures as pairs of [name, text]. */
export function figures(element, pairs) {
  element.replaceChildren(...pairs.map(([name, text]) => {
    const pair = document.createElement("div");
    pair.append(made("span", name), made("b", text));
    return pair;
  }));
}

export function made(tag, text, className) {
  const element = document.createElement(tag);
  element.textContent = text;
  if (className) element.className = className;
  return element;
}

/** An element of SVG with its attributes. */
export function drawn(tag, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

/** An arrow from `from` to `to`, both [x, y] in the units of the picture; nothing when it is too short. */
export function arrow(from, to, className = "arrow") {
  const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
  if (!(length > 0.5)) return [];
  const ux = dx / length, uy = dy / length, head = Math.min(3, length / 2);
  const left = [to[0] - head * ux - head / 2 * uy, to[1] - head * uy + head / 2 * ux];
  const right = [to[0] - head * ux + head / 2 * uy, to[1] - head * uy - head / 2 * ux];
  return [
    drawn("line", { x1: from[0], y1: from[1], x2: to[0] - head * ux / 2, y2: to[1] - head * uy / 2, class: className }),
    drawn("polygon", { points: [to, left, right].map((place) => place.join(",")).join(" "), class: className }),
  ];
}

/** The last seconds of a few series as lines: add(values) appends one sample, draw() paints it. */
export class History {
  constructor(canvas, names, colours, unit, seconds = 30) {
    Object.assign(this, { canvas, names, colours, unit, seconds, samples: [] });
  }

  add(values) {
    const now = performance.now() / 1000;
    this.samples.push([now, ...values]);
    while (this.samples.length && this.samples[0][0] < now - this.seconds) this.samples.shift();
  }

  draw() {
    const { canvas, samples, seconds } = this;
    const width = canvas.width = canvas.clientWidth * devicePixelRatio;
    const height = canvas.height = canvas.clientHeight * devicePixelRatio;
    const pen = canvas.getContext("2d"), size = 12 * devicePixelRatio;
    const now = performance.now() / 1000;
    const values = samples.flatMap((sample) => sample.slice(1)).filter((value) => value !== null);
    const most = Math.max(1, ...values) * 1.1, least = Math.min(0, ...values) * 1.1;
    const y = (value) => height - (value - least) / (most - least) * height;
    pen.strokeStyle = "#343944";
    pen.fillStyle = "#9aa3b2";
    pen.font = `${size}px system-ui, sans-serif`;
    for (let step = 0; step <= 4; step++) {
      const value = least + (most - least) * step / 4;
      pen.beginPath(); pen.moveTo(0, y(value)); pen.lineTo(width, y(value)); pen.stroke();
      if (step && step < 4) pen.fillText(`${value.toFixed(1)} ${this.unit}`, 4, y(value) - 3);
    }
    this.names.forEach((name, series) => {
      pen.strokeStyle = pen.fillStyle = this.colours[series];
      pen.lineWidth = 2 * devicePixelRatio;
      pen.beginPath();
      let isDown = false;
      for (const sample of samples) {
        const value = sample[series + 1], x = width * (1 - (now - sample[0]) / seconds);
        if (value === null) { isDown = false; continue; }
        if (isDown) pen.lineTo(x, y(value)); else pen.moveTo(x, y(value));
        isDown = true;
      }
      pen.stroke();
      pen.fillText(name, width - (pen.measureText(name).width + 8), size * (1.3 + 1.4 * series));
    });
    pen.lineWidth = 1;
  }
}

/** Rows of health as `check` prints them: verdict, part, value, and the way out below. */
export function healthTable(body, rows) {
  body.replaceChildren(...rows.flatMap((row) => {
    const line = document.createElement("tr");
    line.append(made("td", row.verdict, `verdict ${row.verdict}`), made("td", row.part), made("td", row.value));
    if (!row.way_out) return [line];
    const way = document.createElement("tr"), cell = made("td", row.way_out);
    way.className = "way";
    cell.colSpan = 2;
    way.append(made("td", ""), cell);
    return [line, way];
  }));
}
