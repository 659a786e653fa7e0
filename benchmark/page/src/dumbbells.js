// The generalisation drop: a chart a protocol, one line per model, from trained on everything to held out.

import { axisX, axisY, dot, gridX, link, plot, pointer, tip } from "@observablehq/plot";
import { drawn, element } from "./dom.js";
import { powers } from "./numbers.js";
import { label, legend, SYMBOLS, TIP, widthOf } from "./scatter.js";

const FLOOR = 1e-3; // errors below it are drawn at the edge

/** Return the room for names beside an axis, and what shortens a name to it. */
export function besides(width, widest) {
  const left = Math.min(widest, Math.round(width * 0.42));
  const most = Math.floor(left / 6.3);
  const end = Math.floor(most / 3); // names that begin alike differ there
  return { left, short: (text) => (text.length > most ? `${text.slice(0, most - 1 - end)}…${text.slice(-end)}` : text) };
}

/** Draw every protocol of a metric. */
export function dumbbells(container, { board, rows, metric, index }) {
  const { title, share } = index.metrics[metric];
  const scale = (value) => (value === null ? null : share ? 100 * value : Math.max(value, FLOOR));
  const grid = element("div", { class: "charts" });
  container.replaceChildren(grid);
  const charts = board.drops[metric].map((protocol) => {
    const box = element("figure", {}, element("figcaption", {}, `${protocol.title}: mean ${title}`));
    grid.append(box); // all of them before the first is measured
    const points = rows.filter(({ slug }) => protocol.scores[slug]).map((row) => {
      const [before, after] = protocol.scores[row.slug];
      return { name: row.name, kind: row.kind, before: scale(before), after: scale(after), shown: row.cells[protocol.column][0] };
    });
    return { box, points, title: protocol.title };
  });
  const values = charts.flatMap(({ points }) => points.flatMap((one) => [one.before, one.after])).filter((value) => value !== null);
  const domain = share ? [0, 102] : [Math.min(...values) / 1.3, Math.max(...values) * 1.3];
  for (const { box, points, title: protocol } of charts)
    box.append(dumbbell(box, { points, protocol, title, share, domain, kinds: index.kinds }));
  const sample = (fill) => drawn("svg", { width: 12, height: 12, "aria-hidden": "true" }, drawn("circle", { cx: 6, cy: 6, r: 4.5, fill, stroke: "currentColor", "stroke-width": 1.5 }));
  container.append(legend(rows, index.kinds,
    [sample("none"), "trained without what is tested"], [sample("currentColor"), "the same model trained on everything, on the same shapes"]));
}

function dumbbell(box, { points, protocol, title, share, domain, kinds }) {
  const width = widthOf(box);
  const { left, short } = besides(width, 270);
  const said = `${protocol}: mean ${title} of ${points.length} models, trained without what is tested, and trained on everything. The table has all numbers.`;
  const both = points.filter((one) => one.before !== null);
  const colour = (one) => kinds[one.kind];
  const look = { y: "name", r: 4.5, symbol: (one) => SYMBOLS[one.kind], stroke: colour };
  return label(plot({
    width, height: 19 * points.length + 46, marginLeft: left, marginTop: 6, marginBottom: 36, ariaLabel: said,
    x: share ? { domain, label: title } : { type: "log", domain, label: `mean ${title}; below ${FLOOR} at the edge` },
    y: { type: "point", domain: points.map((one) => one.name), label: null },
    symbol: { type: "identity" }, color: { type: "identity" },
    marks: [
      gridX({ ticks: 5, strokeOpacity: 0.12 }), axisX({ ticks: 5, tickFormat: share ? (v) => `${v} %` : powers }), axisY({ tickSize: 0, tickFormat: short }),
      link(both, { x1: "before", x2: "after", y: "name", stroke: colour, strokeWidth: 2, strokeOpacity: 0.6 }),
      dot(both, { ...look, x: "before", fill: colour }),
      dot(points, { ...look, x: "after", fill: "var(--background)" }),
      tip(points, pointer({ x: "after", y: "name", title: (one) => `${one.name}\n${one.shown}`, ...TIP })),
    ],
  }), said);
}
