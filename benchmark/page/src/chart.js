// The charts, drawn by Observable Plot, which the page loads when its table is there.

import { axisX, axisY, dot, gridX, gridY, line, plot, pointer, ruleX, ruleY, tip } from "@observablehq/plot";
import { drawn, element } from "./dom.js";
import { besides, dumbbells } from "./dumbbells.js";
import { front } from "./front.js";
import { difference, faster, powers, signed, thousands } from "./numbers.js";
import { label, legend, listed, sample, scatter, SYMBOLS, through, TIP, widthOf } from "./scatter.js";

const TRUE = "currentColor";
const PREDICTED = "var(--predicted)";

/** Error against speed beside LaPy: the ratio may be compared between machines, so one chart has all rows. */
function errorSpeed(container, { board, rows, key, index, open }) {
  const { title, higher, share } = index.metrics[key];
  const known = board.rows.filter((row) => row.cells[key][1] !== null);
  const timed = known.filter((row) => row.cells.lapy[1] !== null);
  const every = timed.map((row) => ({ ...ofRow(row, { key, title, edge: index.edge, share }), faint: !rows.includes(row) }));
  const best = front(every, higher); // of all rows: a filter makes nobody the best
  for (const one of best) one.first = true;
  const box = element("figure", {}, element("figcaption", {}, `Mean ${title} against speed: how many times as fast as LaPy in the same run, from raw mesh to eigenvalues`));
  container.replaceChildren(box);
  const faint = every.filter((one) => one.faint).length;
  const said = `Mean ${title} against speed beside LaPy, ${every.length} rows${faint ? `, ${faint} of them faint: the filters leave them out` : ""}. On the Pareto front: ${best.map((one) => `${one.row.name} (${one.shown}, ${one.times})`).join("; ")}. The table has all numbers.`;
  const steps = [...best].reverse();
  const below = [line(steps, { x: "x", y: "y", curve: "step-before", stroke: "var(--front)", strokeWidth: 1.5 })];
  const [xs, ys] = [every.map((one) => one.x), every.map((one) => one.y)];
  const domain = { x: around(xs, 1.8), y: share ? [0, 104] : around(ys, 1.9) };
  const unnamed = scatter(box, { points: every, below, steps, domain, share, title: share ? title : `mean ${title}`, said, kinds: index.kinds, open });
  const after = [
    listed("Pareto front: ", best.map((one) => one.row.name)),
    listed("Without a name in the picture: ", unnamed.map((one) => `${one.row.name} (${one.shown}, ${one.times})`)),
    listed("Not timed beside LaPy: ", known.filter((row) => row.cells.lapy[1] === null).map((row) => row.name)),
  ];
  box.append(...after.filter(Boolean));
  container.append(legend(every, index.kinds,
    [sample({ stroke: "var(--front)", "stroke-width": 1.5 }), "Pareto front of all rows"],
    faint ? ["faint: left out by the filters"] : null));
}

const around = (values, factor) => [Math.min(...values) / factor, Math.max(...values) * factor];

function ofRow(row, { key, title, edge, share }) {
  const [shown, value] = row.cells[key];
  const [times, speed] = row.cells.lapy;
  const y = share ? 100 * value : Math.max(value, edge.error);
  const notes = [];
  if (!share && value < edge.error) notes.push(shown);
  if (speed > edge.speed) notes.push(faster(speed));
  const name = row.name + (notes.length ? ` (${notes.join(", ")})` : "");
  const tip = `${row.name}, ${row.kind}\n${title}: ${shown}\n${times} as fast as LaPy`;
  return { row, slug: row.slug, kind: row.kind, name, shown, times, value, time: 1 / speed, x: Math.min(speed, edge.speed), y, title: tip };
}

/** The scaling track: a chart a hardware and size, all with the same axes. */
function scaling(container, { board, rows, index, open }) {
  const grid = element("div", { class: "charts" });
  container.replaceChildren(element("p", { class: "small" }, "Error to the spectrum of the surface against speed: how many times as fast as LaPy, one mesh a call; medians over the surfaces."), grid);
  const several = new Set(board.panels.map(({ setting }) => setting)).size > 1;
  const byName = new Map(rows.map((row) => [row.setting + row.slug, row]));
  const charts = board.panels.map((panel) => {
    const mine = panel.points.filter((one) => byName.has(panel.setting + one.slug)).map((one) => ofMesh(one, byName.get(panel.setting + one.slug), panel, board.fastest));
    const box = element("figure", {}, element("figcaption", {}, element("strong", {}, `${thousands(panel.size)} vertices`), several ? `; ${panel.setting}` : ""));
    grid.append(box); // all of them before the first is measured
    return { box, panel, points: mine.filter((one) => one.x !== null), absent: mine.filter((one) => one.x === null) };
  });
  const all = charts.flatMap(({ points }) => points);
  if (all.length) {
    const domain = { x: around(all.map((one) => one.x), 1.8), y: around(all.map((one) => one.y), 1.8) };
    for (const chart of charts) oneSize(chart, { domain, kinds: index.kinds, open });
  }
  for (const { box, absent } of charts)
    if (absent.length) box.append(listed("Not timed beside LaPy: ", absent.map((one) => one.row.name)));
  container.append(legend(all, index.kinds,
    [sample({ stroke: "var(--front)", "stroke-width": 8, "stroke-opacity": 0.2 }), "where a prediction can win"],
    [sample({ stroke: "currentColor", "stroke-opacity": 0.5, "stroke-width": 1.5 }), "the fastest exact solver on coarser and finer meshes of the same surfaces"],
    ["outlined: wins on most of the surfaces"], ["open: not every surface was answered"]));
}

function ofMesh(one, row, { surfaces }, fastest) {
  const times = one.speed === null ? "" : faster(one.speed);
  const notes = one.speed > fastest ? [times] : [];
  if (one.error > 1) notes.push(one.shown); // drawn at the upper edge
  const wins = one.wins > surfaces / 2;
  const tip = `${row.name}, ${row.kind}\nerror to the surface: ${one.shown}\n${times} as fast as LaPy\nwins on ${one.wins} of ${surfaces} surfaces`;
  return { row, slug: row.slug, kind: row.kind, name: row.name + (notes.length ? ` (${notes.join(", ")})` : ""), shown: one.shown, times, x: one.speed === null ? null : Math.min(one.speed, fastest), y: 100 * Math.min(one.error, 1), open: one.answered < surfaces, wins, first: wins, title: tip };
}

const percent = ([x, share]) => [x, 100 * share];

function oneSize({ box, panel, points }, { domain, kinds, open }) {
  if (!points.length) return;
  const winners = points.filter((one) => one.wins).map((one) => one.row.name);
  const said = `Error to the surface against speed beside LaPy at ${thousands(panel.size)} vertices, ${points.length} models. On most surfaces win: ${winners.join(", ") || "none"}. The table has all numbers.`;
  const far = 10 * domain.x[1];
  const low = domain.y[0] / 10;
  const border = panel.border.map(percent);
  const region = border.length ? through([[border[0][0], low], ...border, [far, border.at(-1)[1]], [far, low]], { fill: "var(--front)", fillOpacity: 0.16, stroke: "none" }) : null;
  const solver = through(panel.solver.map(percent), { stroke: "currentColor", strokeOpacity: 0.5, strokeWidth: 1.5 });
  const unnamed = scatter(box, { points, below: [region, solver].filter(Boolean), domain, title: "mean relative error to the surface, %", said, kinds, open });
  const list = listed("Without a name in the picture: ", unnamed.map((one) => `${one.row.name} (${one.shown}, ${one.times})`));
  if (list) box.append(list);
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
function apart(container, others, name, kinds) {
  const rows = others.filter((one) => one.mean !== null);
  if (!rows.length) return container.replaceChildren("No other row has finite scores.");
  const width = Math.min(820, widthOf(container));
  const { left, short } = besides(width, 280);
  const colour = (one) => kinds[one.kind];
  const sizes = rows.map((one) => Math.abs(one.mean)).sort((a, b) => a - b);
  const least = Math.max(sizes.at(-1) / 1000, sizes[Math.floor(sizes.length / 4)], 1e-12); // what is smaller lies near zero, to scale
  const decades = [-12, -11, -10, -9, -8, -7, -6, -5, -4, -3, -2, -1, 0, 1].map((power) => 10 ** power).filter((value) => value >= (width < 500 ? 3 * least : least / 2) && value <= 2 * sizes.at(-1));
  const few = decades.filter((_, i) => (decades.length - 1 - i) % (width < 500 ? 2 : 1) === 0);
  const domain = [Math.min(0, ...rows.map((one) => one.low ?? one.mean)), Math.max(0, ...rows.map((one) => one.high ?? one.mean))];
  const ticks = [...few.map((value) => -value), 0, ...few].filter((value) => domain[0] <= value && value <= domain[1]);
  const said = `Mean RPD of each other row minus that of ${name}, with 95 % intervals: ${rows.map((one) => `${one.name} ${difference(one.mean)}${one.sure ? "" : ", not decided"}`).join("; ")}.`;
  const svg = plot({
    width, height: 19 * rows.length + 56, marginLeft: left, marginTop: 6, marginBottom: 36, ariaLabel: said,
    x: { type: "symlog", constant: least, label: width < 500 ? "← better · RPD minus this one’s · worse →" : "← the other is better · RPD of the other minus this one’s · worse →", domain },
    y: { type: "point", domain: rows.map((one) => one.name), label: null },
    marks: [
      gridX(ticks, { strokeOpacity: 0.12 }), axisX(ticks, { tickFormat: signed }), axisY({ tickSize: 0, tickFormat: short }),
      ruleX([0], { stroke: "currentColor", strokeOpacity: 0.5 }),
      ruleY(rows.filter((one) => one.low !== null), { y: "name", x1: "low", x2: "high", stroke: colour, strokeWidth: 2 }),
      dot(rows, { x: "mean", y: "name", r: 4, symbol: (one) => SYMBOLS[one.kind], stroke: colour, fill: (one) => (one.sure ? colour(one) : "var(--background)") }),
      tip(rows, pointer({ x: "mean", y: "name", title: (one) => `${one.name}\n${difference(one.mean)}${one.low === null ? "" : ` (${difference(one.low)} to ${difference(one.high)})`}\n${one.sure ? (one.mean < 0 ? "significantly better" : "significantly worse") : "not decided"}`, ...TIP })),
    ],
    color: { type: "identity" }, symbol: { type: "identity" },
  });
  container.replaceChildren(element("figure", {}, label(svg, said), legend(rows, kinds)));
}

eigbench.charts = { apart, dumbbells, errorSpeed, scaling, spectrum };
