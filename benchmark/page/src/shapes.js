// What a row has on its board: the worst and the median shape, tables.

import { element, plainTable } from "./dom.js";
import { get, script } from "./load.js";

/** Return the elements of a row's content, and what to call when the page is left or the theme changes. */
export function makeShapes(name, content) {
  const cards = content.shapes.map((shape) => card(name, shape));
  const tables = content.tables.map((table) => plainTable(table));
  return {
    elements: [
      ...(cards.length ? [element("div", { class: "shapes" }, cards.map((one) => one.element))] : []),
      element("div", { class: "tables" }, tables),
    ],
    start: () => Promise.all(cards.map((one) => one.start())),
    redraw: () => cards.forEach((one) => one.redraw()),
    close: () => cards.forEach((one) => one.close()),
  };
}

/** Return the card of a shape: the mesh, and predicted against true eigenvalues. */
function card(name, shape) {
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
      drawSpectrum(chart, name, shape);
      if (!shape.mesh) return;
      const [packed] = await Promise.all([get(shape.mesh), script("viewer.js")]);
      if (made.isConnected) view = eigbench.view(mesh, packed, label);
    },
    redraw: () => {
      drawSpectrum(chart, name, shape);
      view?.redraw();
    },
    close: () => view?.close(),
  };
}

function drawSpectrum(container, name, shape) {
  eigbench.charts.spectrum(container, shape, `Eigenvalues 1 to ${shape.label.length} of ${shape.id}: true, and predicted by ${name}. The numbers are in the table below.`);
}

function numbers(shape) {
  const digits = (value) => (value === null ? "" : value.toPrecision(4));
  const rows = shape.label.map((value, i) => [`λ${i + 1}`, digits(value), digits(shape.predicted[i]), shape.errors[i]]);
  return element("details", {}, element("summary", {}, "Numbers"),
    plainTable({ title: `Eigenvalues of the ${shape.name} shape in 1/length²`, headers: ["", "true", "predicted", "relative error"], rows }, "h4"));
}
