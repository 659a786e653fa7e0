// The charts, drawn by Observable Plot: error against time, protocols, scaling, spectra.

import { axisX, axisY, dot, gridX, gridY, line, plot, pointer, ruleY, text, tip } from "@observablehq/plot";
import { drawn, element, mark } from "./dom.js";
import { front, labels } from "./front.js";

const SYMBOLS = { trivial: "square", classical: "circle", learned: "triangle" };
const TRUE = "currentColor";
const PREDICTED = "var(--predicted)";
// Okabe and Ito, as in figures.py
const PROTOCOLS = [["circle", "currentColor"], ["square", "#E69F00"], ["triangle", "#56B4E9"], ["diamond", "#009E73"], ["star", "#D55E00"], ["plus", "#CC79A7"], ["times", "#0072B2"]];
const LINES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#808080"];
const DASHES = ["", "6 3", "2 3"];

const widthOf = (container, least = 280) => Math.max(least, Math.floor(container.getBoundingClientRect().width));
const powers = (value) => (value === 0 || (value >= 1e-3 && value < 1e5) ? String(+value.toPrecision(2)) : value.toExponential(0));
const thousands = (value) => value.toLocaleString("en");

// Plot labels the group of a mark, which has no role and is drawn anew at each move
const unlabelled = (index, scales, values, dimensions, context, next) => {
  const group = next(index, scales, values, dimensions, context);
  group?.removeAttribute("aria-label");
  return group;
};
const TIP = { fill: "var(--raised)", stroke: "var(--line)", render: unlabelled };

/** Put pictures into figures, each with its caption. */
function figure(picture, caption) {
  return element("figure", {}, caption ? element("figcaption", {}, caption) : null, picture);
}

function label(svg, said) {
  for (const part of svg.querySelectorAll("g[aria-label]")) part.removeAttribute("aria-label"); // of no role
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", said);
  return svg;
}

/** Error against time, a chart for each hardware: times are not compared across. */
function errorTime(container, { board, rows, key, index, open }) {
  const settings = [...new Set(board.rows.map((row) => row.setting))].filter((setting) => rows.some((row) => row.setting === setting));
  const { title, higher, share } = index.metrics[key];
  const grid = element("div", { class: "charts" });
  container.replaceChildren(grid);
  const made = settings.map((setting) => {
    const points = board.rows
      .filter((row) => row.setting === setting && row.cells[key][1] !== null)
      .map((row) => ({ ...point(row, key, index.edge, share), faint: !rows.includes(row) }));
    const best = front(points, higher); // of all rows: a filter makes nobody the best
    const box = element("figure", {}, element("figcaption", {}, setting));
    grid.append(box);
    return { box, points, best, setting };
  });
  for (const { box, points, best, setting } of made) {
    box.append(
      scatter(box, { points, best, title, share, setting, kinds: index.kinds, edge: index.edge, open }),
      element("p", { class: "small" }, element("strong", {}, "Pareto front: "), best.map((one) => one.row.name).join(", ") || "no row", "."));
  }
  container.append(legend(made.flatMap(({ points }) => points), index.kinds));
}

function point(row, key, edge, share) {
  const [shown, value] = row.cells[key];
  const y = share ? 100 * value : Math.max(value, edge.error);
  const notes = [];
  if (!share && value < edge.error) notes.push(powers(value));
  if (row.ms < edge.ms) notes.push(`${powers(row.ms)} ms`);
  const name = row.name + (notes.length ? ` (${notes.join(", ")})` : "");
  return { row, name, shown, value, time: row.ms, x: Math.max(row.ms, edge.ms), y };
}

function scatter(box, { points, best, title, share, setting, kinds, open }) {
  const width = widthOf(box);
  const height = 300;
  const xs = points.map((one) => one.x);
  const ys = points.map((one) => one.y);
  const [shown, faint] = [points.filter((one) => !one.faint), points.filter((one) => one.faint)];
  const x = { type: "log", domain: [Math.min(...xs) / 1.8, Math.max(...xs) * 2.5], label: "ms a mesh, median" };
  const y = share
    ? { domain: [0, 104], label: title }
    : { type: "log", domain: [Math.min(...ys) / 1.8, Math.max(...ys) * 2], label: `mean ${title}` };
  const said = `Mean ${title} against milliseconds a mesh on ${setting}, both logarithmic, ${points.length} rows${faint.length ? `, ${faint.length} of them faint: the filters leave them out` : ""}. On the Pareto front: ${best.map((one) => `${one.row.name} (${one.shown}, ${powers(one.time)} ms)`).join("; ")}. The table has all numbers.`;
  const marks = { x: "x", y: "y", r: 5, symbol: (one) => SYMBOLS[one.row.kind], fill: (one) => kinds[one.row.kind], stroke: "var(--background)", strokeWidth: 0.75 };
  const svg = plot({
    width, height, marginLeft: 46, marginBottom: 36, marginRight: 10, x, y,
    ariaLabel: said,
    marks: [
      gridX({ ticks: 5, strokeOpacity: 0.12 }), gridY({ ticks: 5, strokeOpacity: 0.12 }),
      axisX({ ticks: 5, tickFormat: powers, tickSize: 3 }), axisY({ ticks: 5, tickFormat: share ? (v) => `${v} %` : powers, tickSize: 3 }),
      line(best, { x: "x", y: "y", curve: "step-after", stroke: "var(--front)", strokeWidth: 1.5 }),
      dot(faint, { ...marks, fillOpacity: 0.25 }),
      dot(shown, marks),
      tip(shown, pointer({ x: "x", y: "y", title: (one) => `${one.row.name}, ${one.row.kind}\n${title}: ${one.shown}\n${powers(one.time)} ms a mesh\nclick to open its row`, ...TIP })),
    ],
    symbol: { type: "identity" }, color: { type: "identity" },
  });
  label(svg, said);
  svg.classList.add("clickable");
  svg.addEventListener("click", () => svg.value && open(svg.value.row.slug));
  name(svg, { points, best, width, height });
  return svg;
}

/** Write names beside points where there is room, below the tip: first those on the front. */
function name(svg, { points, best, width, height }) {
  const [x, y] = ["x", "y"].map((axis) => svg.scale(axis));
  const ordered = [...best, ...points.filter((one) => !one.faint && !best.includes(one))];
  const at = ordered.map((one) => ({ x: x.apply(one.x), y: y.apply(one.y), text: one.name, above: best.includes(one) }));
  for (const { x: left, y: middle, anchor, text: title } of labels(at, [], { left: 48, right: width - 4, top: 4, bottom: height - 38 }))
    svg.lastElementChild.before(drawn("text", { x: left, y: middle, "text-anchor": anchor, dy: "0.32em", fill: "currentColor", class: "name" }, title));
}

function legend(points, kinds) {
  const present = Object.keys(kinds).filter((kind) => points.some(({ row }) => row.kind === kind));
  const sample = (attributes) => drawn("svg", { width: 22, height: 10, "aria-hidden": "true" }, drawn("line", { x1: 0, x2: 22, y1: 5, y2: 5, ...attributes }));
  return element("p", { class: "legend" },
    present.map((kind) => element("span", {}, mark(kind, kinds), kind)),
    element("span", {}, sample({ stroke: "var(--front)", "stroke-width": 1.5 }), "Pareto front of all rows"),
    points.some((one) => one.faint) ? element("span", {}, "faint: left out by the filters") : null);
}

/** Each model's error i.i.d. and under each protocol, a line a model. */
function protocols(container, { board, rows, group, index }) {
  const { title: metric, share } = index.metrics[group.key.replace("protocols-", "")];
  const titles = group.columns.map((key) => board.columns[key].title);
  const points = rows.flatMap((row) => group.columns.map((key, i) => ({ name: row.name, value: row.cells[key][1], shown: row.cells[key][0], column: titles[i], i }))
    .filter((one) => one.value !== null)
    .map((one) => ({ ...one, x: share ? 100 * one.value : Math.max(one.value, 1e-3) })));
  const spans = rows.flatMap((row) => points.filter((one) => one.name === row.name));
  const width = widthOf(container);
  const left = Math.min(260, Math.round(width * 0.42));
  const most = Math.floor(left / 6.2);
  const short = (text) => (text.length > most ? `${text.slice(0, most - 1)}…` : text);
  const said = `Mean ${metric} of each model i.i.d. and under each protocol. The table has all numbers.`;
  const svg = plot({
    width, height: 22 * rows.length + 60, marginLeft: left, marginTop: 10, marginBottom: 38, ariaLabel: said,
    x: share ? { label: metric } : { type: "log", label: `mean ${metric}; below 0.001 at the edge` },
    y: { type: "point", domain: rows.map((row) => row.name), label: null },
    symbol: { type: "identity" }, color: { type: "identity" },
    marks: [
      gridX({ ticks: 5, strokeOpacity: 0.12 }), axisX({ ticks: 5, tickFormat: share ? (v) => `${v} %` : powers }), axisY({ tickSize: 0, tickFormat: short }),
      line(spans, { x: "x", y: "name", z: "name", stroke: "currentColor", strokeOpacity: 0.3 }),
      dot(points, { x: "x", y: "name", r: 4.5, symbol: (one) => PROTOCOLS[one.i % PROTOCOLS.length][0], stroke: (one) => PROTOCOLS[one.i % PROTOCOLS.length][1], fill: (one) => PROTOCOLS[one.i % PROTOCOLS.length][1] }),
      tip(points, pointer({ x: "x", y: "name", title: (one) => `${one.name}\n${one.column}: ${one.shown}`, ...TIP })),
    ],
  });
  const entries = titles.map((title, i) => {
    const [symbol, colour] = PROTOCOLS[i % PROTOCOLS.length];
    const key = plot({ width: 14, height: 14, margin: 0, axis: null, symbol: { type: "identity" }, color: { type: "identity" }, x: { domain: [0, 1] }, y: { domain: [0, 1] }, marks: [dot([[0.5, 0.5]], { r: 4.5, symbol, stroke: colour, fill: colour })] });
    key.setAttribute("aria-hidden", "true");
    return element("span", {}, key, title);
  });
  container.replaceChildren(figure(label(svg, said)), element("p", { class: "legend" }, entries));
}

/** Time and error against vertices, a pair of charts for each hardware. */
function scaling(container, { board, rows }) {
  const grid = element("div", { class: "charts" });
  const looks = new Map(board.rows.map((row, i) => [row, [LINES[i % LINES.length], DASHES[Math.floor(i / LINES.length) % DASHES.length]]]));
  container.replaceChildren(grid);
  const charts = [...new Set(rows.map((row) => row.setting))].flatMap((setting) =>
    [["ms", "ms a mesh", 0], ["error", "mean relative error", 1e-6]].map(([key, title, least]) => {
      const box = element("figure", {}, element("figcaption", {}, `${title}; ${setting}`));
      grid.append(box); // all of them before the first is measured
      return { box, key, title, least, setting, mine: rows.filter((row) => row.setting === setting) };
    }));
  for (const chart of charts) chart.box.append(against(chart, board, looks));
  const sample = (stroke, dash, width) => drawn("svg", { width: 22, height: 10, "aria-hidden": "true" }, drawn("line", { x1: 0, x2: 22, y1: 5, y2: 5, stroke, "stroke-dasharray": dash || "none", "stroke-width": width }));
  container.append(element("p", { class: "legend" },
    rows.map((row) => element("span", {}, sample(...looks.get(row), 1.6), row.name)),
    element("span", {}, sample("color-mix(in srgb, currentColor 30%, transparent)", "", 4), "discretisation error of the meshes; an empty mark: not every surface was answered")));
}

/** One quantity of the scaling track against vertices. */
function against({ box, key, title, least, setting, mine }, board, looks) {
  const points = mine.flatMap((row) => row.points.filter((one) => one[key] !== null).map((one) => ({ ...one, row, y: Math.max(one[key], least || 1e-9) })));
  const said = `${title} against vertices on ${setting}, both logarithmic, ${mine.length} models. The table has all numbers.`;
  const svg = plot({
    width: widthOf(box), height: 300, marginLeft: 52, marginBottom: 36, ariaLabel: said,
    x: { type: "log", label: "vertices" }, y: { type: "log", label: least ? `${title}, from ${powers(least)} up` : title },
    color: { type: "identity" },
    marks: [
      gridX({ ticks: 4, strokeOpacity: 0.12 }), gridY({ ticks: 5, strokeOpacity: 0.12 }),
      axisX({ ticks: 4, tickFormat: thousands }), axisY({ ticks: 5, tickFormat: powers }),
      key === "error" ? line(board.own, { x: "0", y: "1", stroke: "currentColor", strokeOpacity: 0.3, strokeWidth: 4 }) : null,
      ...mine.map((row) => line(points.filter((one) => one.row === row), { x: "size", y: "y", stroke: looks.get(row)[0], strokeDasharray: looks.get(row)[1], strokeWidth: 1.4 })),
      dot(points, { x: "size", y: "y", r: 3.5, stroke: (one) => looks.get(one.row)[0], fill: (one) => (one.whole ? looks.get(one.row)[0] : "var(--background)") }),
      tip(points, pointer({ x: "size", y: "y", title: (one) => `${one.row.name}\n${thousands(one.size)} vertices: ${one.row.cells[`${key}-${one.size}`][0]}`, ...TIP })),
    ],
  });
  return label(svg, said);
}

/** Predicted against true eigenvalues of a shape. */
function spectrum(container, shape, said) {
  const rows = shape.label.flatMap((value, i) => [
    { i: i + 1, value, what: "true" },
    { i: i + 1, value: shape.predicted[i], what: "predicted" },
  ]);
  const of = (what) => rows.filter((row) => row.what === what && row.value !== null);
  const svg = plot({
    width: Math.min(420, widthOf(container, 240)), height: 220, marginLeft: 44, marginBottom: 34, ariaLabel: said,
    x: { domain: [0.5, shape.label.length + 0.5], label: "index" },
    y: { domain: [0, 1.05 * Math.max(...rows.map((row) => row.value))], label: "eigenvalue, 1/length²" },
    marks: [
      gridY({ ticks: 5, strokeOpacity: 0.12 }),
      axisX(shape.label.map((_, i) => i + 1), { tickSize: 3, tickFormat: String }), axisY({ ticks: 5, tickSize: 3, tickFormat: powers }),
      dot(of("true"), { x: "i", y: "value", r: 4.5, stroke: TRUE }),
      dot(of("predicted"), { x: "i", y: "value", r: 4, symbol: "times", stroke: PREDICTED, strokeWidth: 2 }),
    ],
  });
  const key = element("p", { class: "legend" },
    element("span", {}, drawn("svg", { width: 12, height: 12, "aria-hidden": "true" }, drawn("circle", { cx: 6, cy: 6, r: 4, fill: "none", stroke: TRUE, "stroke-width": 1.5 })), "true"),
    element("span", {}, drawn("svg", { width: 12, height: 12, "aria-hidden": "true" }, drawn("path", { d: "M2 2 10 10M2 10 10 2", stroke: PREDICTED, "stroke-width": 2 })), "predicted"));
  container.replaceChildren(label(svg, said), key);
}

eigbench.charts = { errorTime, protocols, scaling, spectrum };
