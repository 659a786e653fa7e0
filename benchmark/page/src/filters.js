// The forms: which board, which columns, which rows.

import { element, mark } from "./dom.js";
import { column, columnsShown, groupOf, sortKey } from "./table.js";

let count = 0;

/** Return a labelled select; options are pairs of value and title. */
function select(title, options, value, change, attributes = {}) {
  const id = `select-${(count += 1)}`;
  const made = element("select", { id, ...attributes, change: () => change(made.value) },
    options.map(([key, text]) => element("option", { value: key, selected: key === value }, text)));
  return element("div", { class: "field" }, element("label", { for: id }, title), made);
}

/** Fill the form that chooses a board. */
export function renderWhich(form, index, key, change) {
  const dataset = index.datasets.find(({ boards }) => boards.some(([board]) => board === key));
  const datasets = index.datasets.map(({ title }) => [title, title]);
  const fields = [
    select("Dataset", datasets, dataset.title, (title) => {
      change(index.datasets.find((one) => one.title === title).boards[0][0]);
    }, { name: "dataset" }),
  ];
  fields.push(select("Protocol", dataset.boards, key, change, { name: "protocol" }));
  form.onsubmit = (event) => event.preventDefault();
  keepFocus(form, () => form.replaceChildren(...fields));
}

/** Fill the form of filters of a board, as the state has them. */
export function renderFilters(form, board, state, kinds, { narrow, metrics, change }) {
  const present = Object.keys(kinds).filter((kind) => board.rows.some((row) => row.kind === kind));
  const chosen = state.kinds ?? present;
  const boxes = present.map((kind) => {
    const box = element("input", { type: "checkbox", name: "kind", value: kind, checked: chosen.includes(kind), change: () => {
      const left = present.filter((one) => (one === kind ? box.checked : chosen.includes(one)));
      change({ kinds: left.length === present.length ? null : left });
    } });
    return element("label", { class: "kind-box" }, box, mark(kind, kinds), kind);
  });
  const values = (key) => ["", ...new Set(board.rows.map((row) => row[key]))].map((text) => [text, text || "any"]);
  const find = element("input", { type: "search", id: "find", name: "find", value: state.find, autocomplete: "off", input: () => change({ find: find.value }, false) });
  const fields = [
    select("Columns", board.groups.map(({ key, title }) => [key, title]), groupOf(board, state).key, (columns) => change({ columns }), { name: "columns" }),
    element("fieldset", { class: "field" }, element("legend", {}, "Kind"), boxes),
    select("Training data", values("training"), state.training, (training) => change({ training }), { name: "training" }),
    select("Hardware", values("setting"), state.setting, (setting) => change({ setting }), { name: "hardware" }),
    element("div", { class: "field" }, element("label", { for: "find" }, "Model"), find),
  ];
  if (metrics)
    fields.push(select("Chart", Object.entries(metrics).map(([key, { title }]) => [key, title]), state.metric, (metric) => change({ metric }), { name: "metric" }));
  if (narrow) fields.push(...sorting(board, state, change));
  fields.push(element("button", { type: "button", class: "reset", click: () =>
    change({ columns: "", sort: "", down: false, kinds: null, training: "", setting: "", find: "", metric: "" }) }, "Reset"));
  form.onsubmit = (event) => event.preventDefault();
  keepFocus(form, () => form.replaceChildren(...fields));
}

/** On a narrow screen the rows are cards without heads to sort by. */
function sorting(board, state, change) {
  const keys = [...new Set([...columnsShown(board, state), sortKey(board, state)])].filter(Boolean);
  const options = keys.map((key) => [key, column(board, key).title]);
  return [
    select("Sort by", options, sortKey(board, state), (sort) => change({ sort, down: column(board, sort).higher }), { name: "sort" }),
    select("Order", [["", "ascending"], ["down", "descending"]], state.down ? "down" : "", (order) =>
      change({ sort: sortKey(board, state), down: order === "down" }), { name: "order" }),
  ];
}

/** Let the control that has the focus have it when the form was made anew. */
function keepFocus(form, make) {
  const had = form.contains(document.activeElement) ? document.activeElement : null;
  make();
  if (!had) return;
  const same = [...form.elements].find((one) => one.name && one.name === had.name && (one.type !== "checkbox" || one.value === had.value));
  (same ?? form.querySelector(".reset"))?.focus({ preventScroll: true });
}
