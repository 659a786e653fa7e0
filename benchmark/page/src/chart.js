// The charts, drawn by Observable Plot: error against speed, differences, protocols, scaling, spectra.

import { axisX, axisY, dot, gridX, gridY, line, plot, pointer, ruleX, ruleY, tip } from "@observablehq/plot";
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

/** Return the room for names beside an axis, and what shortens a name to it. */
function besides(width, widest) {
  const left = Math.min(widest, Math.round(width * 0.42));
  const most = Math.floor(left / 6.2);
  return { left, short: (text) => (text.length > most ? `${text.slice(0, most - 1)}…` : text) };
}

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

/** Error against speed beside LaPy: the ratio may be compared between machines, so one chart has all rows. */
function errorSpeed(container, { board, rows, key, index, open }) {
  const { title, higher, share } = index.metrics[key];
  const known = board.rows.filter((row) => row.cells[key][1] !== null);
  const points = known.filter((row) => row.cells.lapy[1] !== null).map((row) => ({ ...point(row, key, index.edge, share), faint: !rows.includes(row) }));
  const best = front(points, higher); // of all rows: a filter makes nobody the best
  const box = element("figure", {}, element("figcaption", {}, `Mean ${title} against speed: how many times faster than LaPy in the same run, from raw mesh to eigenvalues`));
  container.replaceChildren(box);
  const { svg, unnamed } = scatter(box, { points, best, title, share, kinds: index.kinds, open });
  const list = (text, names) => (names.length ? element("p", { class: "small" }, element("strong", {}, text), names.join(", "), ".") : null);
  const after = [
    list("Pareto front: ", best.map((one) => one.row.name)),
    list("Without a name in the picture: ", unnamed.map((one) => `${one.row.name} (${one.row.cells[key][0]}, ${one.row.cells.lapy[0]})`)),
    list("Not timed beside LaPy: ", known.filter((row) => row.cells.lapy[1] === null).map((row) => row.name)),
  ];
  box.append(svg, ...after.filter(Boolean));
  container.append(legend(points, index.kinds));
}

function point(row, key, edge, share) {
  const [shown, value] = row.cells[key];
  const [times, speed] = row.cells.lapy;
  const y = share ? 100 * value : Math.max(value, edge.error);
  const notes = [];
  if (!share && value < edge.error) notes.push(shown);
  if (speed > edge.speed) notes.push(times);
  const name = row.name + (notes.length ? ` (${notes.join(", ")})` : "");
  return { row, name, shown, times, value, time: 1 / speed, x: Math.min(speed, edge.speed), y };
}

function scatter(box, { points, best, title, share, kinds, open }) {
  const width = widthOf(box);
  const height = 380;
  const xs = points.map((one) => one.x);
  const ys = points.map((one) => one.y);
  const [shown, faint] = [points.filter((one) => !one.faint), points.filter((one) => one.faint)];
  const x = { type: "log", domain: [Math.min(...xs) / 1.8, Math.max(...xs) * 1.8], label: "times faster than LaPy →" };
  const y = share
    ? { domain: [0, 104], label: title }
    : { type: "log", domain: [Math.min(...ys) / 1.8, Math.max(...ys) * 2], label: `mean ${title}` };
  const said = `Mean ${title} against speed beside LaPy, ${points.length} rows${faint.length ? `, ${faint.length} of them faint: the filters leave them out` : ""}. On the Pareto front: ${best.map((one) => `${one.row.name} (${one.shown}, ${one.times})`).join("; ")}. The table has all numbers.`;
  const marks = { x: "x", y: "y", r: 5, symbol: (one) => SYMBOLS[one.row.kind], fill: (one) => kinds[one.row.kind], stroke: "var(--background)", strokeWidth: 0.75 };
  const svg = plot({
    width, height, marginLeft: 46, marginBottom: 36, marginRight: 10, x, y,
    ariaLabel: said,
    marks: [
      gridX({ ticks: 5, strokeOpacity: 0.12 }), gridY({ ticks: 5, strokeOpacity: 0.12 }),
      axisX({ ticks: 5, tickFormat: (v) => `${powers(v)} ×`, tickSize: 3 }), axisY({ ticks: 5, tickFormat: share ? (v) => `${v} %` : powers, tickSize: 3 }),
      line([...best].reverse(), { x: "x", y: "y", curve: "step-before", stroke: "var(--front)", strokeWidth: 1.5 }),
      dot(faint, { ...marks, fillOpacity: 0.25 }),
      dot(shown, marks),
      tip(shown, pointer({ x: "x", y: "y", title: (one) => `${one.row.name}, ${one.row.kind}\n${title}: ${one.shown}\n${one.times} faster than LaPy\nclick to open its page`, ...TIP })),
    ],
    symbol: { type: "identity" }, color: { type: "identity" },
  });
  label(svg, said);
  svg.classList.add("clickable");
  svg.addEventListener("click", () => svg.value && open(svg.value.row.slug));
  svg.addEventListener("input", () => pointedAt(svg.value?.row.slug));
  svg.points = points.map((one) => ({ slug: one.row.slug, x: svg.scale("x").apply(one.x), y: svg.scale("y").apply(one.y) }));
  return { svg, unnamed: name(svg, { points, best, width, height }) };
}

/** Let the row of the point under the pointer stand out in the table. */
function pointedAt(slug) {
  for (const row of document.querySelectorAll("tr.pointed")) row.classList.remove("pointed");
  if (slug) document.getElementById(`row-${slug}`)?.classList.add("pointed");
}

/** Write names beside points where there is room, below the tip, first those on the front; return the points without. */
function name(svg, { points, best, width, height }) {
  const [x, y] = ["x", "y"].map((axis) => svg.scale(axis));
  const ordered = [...best, ...points.filter((one) => !one.faint && !best.includes(one)), ...points.filter((one) => one.faint && !best.includes(one))];
  const at = ordered.map((one) => ({ one, x: x.apply(one.x), y: y.apply(one.y), text: one.name, above: best.includes(one) }));
  const written = labels(at, { left: 48, right: width - 4, top: 4, bottom: height - 38 }).filter(({ point }) => !point.one.faint || best.includes(point.one));
  for (const { point, x: left, y: middle, anchor, text: title } of written)
    svg.lastElementChild.before(drawn("text", { x: left, y: middle, "text-anchor": anchor, dy: "0.32em", fill: "currentColor", class: "name", "data-slug": point.one.row.slug }, title));
  return ordered.filter((one) => !one.faint && !written.some(({ point }) => point.one === one));
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
  const { left, short } = besides(width, 260);
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

/** How far each other row is from one: the paired difference and its interval, a line each. */
function apart(container, others, name) {
  const rows = others.filter((one) => one.mean !== null);
  if (!rows.length) return container.replaceChildren("No other row has finite scores.");
  const width = Math.min(820, widthOf(container));
  const { left, short } = besides(width, 280);
  const sizes = rows.map((one) => Math.abs(one.mean)).sort((a, b) => a - b);
  const least = Math.max(sizes.at(-1) / 1000, sizes[Math.floor(sizes.length / 4)], 1e-12); // what is smaller lies near zero, to scale
  const decades = [-12, -11, -10, -9, -8, -7, -6, -5, -4, -3, -2, -1, 0, 1].map((power) => 10 ** power).filter((value) => value >= least / 2 && value <= 2 * sizes.at(-1));
  const few = decades.filter((_, i) => (decades.length - 1 - i) % (width < 500 ? 2 : 1) === 0);
  const ticks = [...few.map((value) => -value), 0, ...few];
  const said = `Mean RPD of each other row minus that of ${name}, with 95 % intervals: ${rows.map((one) => `${one.name} ${signed(one.mean)}${one.sure ? "" : ", not decided"}`).join("; ")}.`;
  const svg = plot({
    width, height: 19 * rows.length + 56, marginLeft: left, marginTop: 6, marginBottom: 36, ariaLabel: said,
    x: { type: "symlog", constant: least, label: "← nearer · RPD of the other − this row · further →", domain: [Math.min(0, ...rows.map((one) => one.low ?? one.mean)), Math.max(0, ...rows.map((one) => one.high ?? one.mean))] },
    y: { type: "point", domain: rows.map((one) => one.name), label: null },
    marks: [
      gridX(ticks, { strokeOpacity: 0.12 }), axisX(ticks, { tickFormat: signed }), axisY({ tickSize: 0, tickFormat: short }),
      ruleX([0], { stroke: "currentColor", strokeOpacity: 0.5 }),
      ruleY(rows.filter((one) => one.low !== null), { y: "name", x1: "low", x2: "high", stroke: "var(--predicted)", strokeWidth: 2 }),
      dot(rows, { x: "mean", y: "name", r: 4, stroke: "var(--predicted)", fill: (one) => (one.sure ? "var(--predicted)" : "var(--background)") }),
      tip(rows, pointer({ x: "mean", y: "name", title: (one) => `${one.name}\n${signed(one.mean)}${one.low === null ? "" : ` (${signed(one.low)} to ${signed(one.high)})`}\n${one.sure ? (one.mean < 0 ? "surely better" : "surely worse") : "not decided"}`, ...TIP })),
    ],
    color: { type: "identity" },
  });
  container.replaceChildren(figure(label(svg, said)));
}

const signed = (value) => (value === 0 ? "0" : `${value > 0 ? "+" : "−"}${powers(Math.abs(value))}`);

eigbench.charts = { apart, errorSpeed, protocols, scaling, spectrum };
