// The guided calibration on the page of a fingertip: the present step, its verdict, and a button for each answer.
import { byId, command, figures, made, mayCommand } from "/console.js";

let actions = "";

/** Send the answers of the buttons; Enter in the field of a number sends it too. */
export function prepareGuide() {
  const row = byId("guide-actions");
  row.addEventListener("click", (event) => {
    const action = event.target.dataset.action;
    if (action) send(action);
  });
  row.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target.tagName === "INPUT") send(event.target.dataset.of);
  });
}

function send(action) {
  const field = byId("guide-actions").querySelector("input");
  const isOfNumber = field && field.dataset.of === action;
  command({ command: "guide", action, ...(isOfNumber && field.value !== "" ? { number: Number(field.value) } : {}) });
}

export function showGuide(view) {
  byId("guide").dataset.step = view.number;
  byId("guide-step").textContent = `${view.number}/${view.steps}: ${view.title}`;
  byId("guide-instruction").textContent = view.instruction;
  const verdict = view.verdict === "absent" ? "wait" : view.verdict;
  byId("guide-verdict").replaceChildren(made("span", verdict, `verdict ${view.verdict}`), ` ${view.text}`);
  const progress = byId("guide-progress");
  progress.hidden = view.total === 0;
  progress.max = Math.max(1, view.total);
  progress.value = view.done;
  figures(byId("guide-figures"), view.figures);
  const wanted = JSON.stringify(view.actions);
  if (wanted !== actions) byId("guide-actions").replaceChildren(...view.actions.flatMap(answerElements));
  actions = wanted;
}

/** A button, with a field before it where the answer is a number. */
function answerElements(action) {
  const button = made("button", action.label);
  button.dataset.action = action.name;
  button.disabled = !mayCommand;
  if (!action.unit) return [button];
  const label = made("label", action.unit), field = document.createElement("input");
  field.type = "number";
  field.min = 0;
  field.step = "any";
  field.dataset.of = action.name;
  field.disabled = !mayCommand;
  label.prepend(field);
  return [label, button];
}
