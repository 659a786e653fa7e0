// What a row opens to: facts, the worst and the median shape, tables.

import { element, plainTable } from "./dom.js";
import { get, script } from "./load.js";

/** Return the element of an opened row, and what to call when it is closed or the theme changes. */
export function makeDetail(board, row) {
  const body = element("div", { class: "detail" }, element("p", {}, "Loading …"));
  const parts = [];
  let closed = false;
  const ready = get(`rows/${board.key}/${row.slug}`).then(async (content) => {
    if (closed) return;
    const cards = content.shapes.map((shape) => card(row, shape));
    body.replaceChildren(
      facts(content.facts),
      ...(cards.length ? [element("div", { class: "shapes" }, cards.map((one) => one.element))] : []),
      element("div", { class: "tables" }, content.tables.map((table) => plainTable(table))));
    for (const one of cards) parts.push(one);
    await Promise.all(cards.map((one) => one.start()));
  }).catch((error) => body.append(element("p", { class: "error" }, error.message)));
  return {
    element: body,
    ready,
    redraw: () => parts.forEach((one) => one.redraw()),
    close: () => {
      closed = true;
      parts.forEach((one) => one.close());
    },
  };
}

function facts(pairs) {
  return element("dl", { class: "facts" }, pairs.map(([title, text]) => {
    const link = /^https:\/\/\S+$/.test(text) ? element("a", { href: text, rel: "noreferrer" }, text) : text;
    return element("div", {}, element("dt", {}, title), element("dd", {}, link));
  }));
}

/** Return the card of a shape: the mesh, and predicted against true eigenvalues. */
function card(row, shape) {
  const title = `${shape.name[0].toUpperCase()}${shape.name.slice(1)} shape by RPD: ${shape.family}`;
  const scores = shape.scores.map(([name, text]) => `${name} ${text}`).join(", ");
  const parameters = Object.entries(shape.parameters).map(([name, text]) => `${name.replaceAll("_", " ")} ${text}`).join(", ");
  const mesh = element("div", { class: "mesh" }, element("p", {}, shape.mesh ? "Loading the mesh …" : shape.why));
  const chart = element("div", { class: "spectrum" });
  const made = element("section", { class: "shape" },
    element("h3", {}, title),
    element("p", {}, element("code", {}, shape.id), `: ${scores}`),
    element("div", { class: "pair" }, mesh, element("div", {}, chart, numbers(shape))),
    parameters ? element("p", { class: "small" }, `Drawn with ${parameters}.`) : null,
    shape.several ? element("p", { class: "small" }, "Predicted by the first seed.") : null);
  let view = null;
  const label = `${title}, mesh ${shape.id}`;
  return {
    element: made,
    start: async () => {
      drawSpectrum(chart, row, shape);
      if (!shape.mesh) return;
      const [packed] = await Promise.all([get(shape.mesh), script("viewer.js")]);
      if (made.isConnected) view = eigbench.view(mesh, packed, label);
    },
    redraw: () => {
      drawSpectrum(chart, row, shape);
      view?.redraw();
    },
    close: () => view?.close(),
  };
}

function drawSpectrum(container, row, shape) {
  eigbench.charts.spectrum(container, shape, `Eigenvalues 1 to ${shape.label.length} of ${shape.id}: true, and predicted by ${row.name}. The numbers are in the table below.`);
}

function numbers(shape) {
  const digits = (value) => (value === null ? "" : value.toPrecision(4));
  const rows = shape.label.map((value, i) => [`λ${i + 1}`, digits(value), digits(shape.predicted[i]), shape.errors[i]]);
  return element("details", {}, element("summary", {}, "Numbers"),
    plainTable({ title: `Eigenvalues of the ${shape.name} shape in 1/length²`, headers: ["", "true", "predicted", "relative error"], rows }, "h4"));
}
