// Error against speed beside LaPy: the one grammar of the charts. Colour and mark tell the kind.

import { axisX, axisY, dot, gridX, gridY, line, plot, pointer, tip } from "@observablehq/plot";
import { drawn, element, mark } from "./dom.js";
import { labels, stairs } from "./front.js";
import { point as pointAt } from "./linked.js";
import { powers } from "./numbers.js";

export const SYMBOLS = { trivial: "square", classical: "circle", learned: "triangle" };
const NAME_SIZE = 10.5; // pixels
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 10, 14, 36]; // margins

// Plot labels the group of a mark, which has no role and is drawn anew at each move
const unlabelled = (index, scales, values, dimensions, context, next) => {
  const group = next(index, scales, values, dimensions, context);
  group?.removeAttribute("aria-label");
  return group;
};
export const TIP = { fill: "var(--raised)", stroke: "var(--line)", render: unlabelled };

/** Return how wide a container is. */
export const widthOf = (container, least = 280) => Math.max(least, Math.floor(container.getBoundingClientRect().width));

/** Let a chart be one picture for screen readers. */
export function label(svg, said) {
  for (const part of svg.querySelectorAll("g[aria-label]")) part.removeAttribute("aria-label"); // of no role
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", said);
  return svg;
}

/**
 * Draw points into a figure; return those whose name has no room. A point has slug, name, kind, x, y
 * and title, and may be faint, open, a winner, or first, on the line of the best.
 */
export function scatter(box, { points, below = [], steps = [], domain, share = false, title, said, kinds, open }) {
  const width = widthOf(box);
  const height = 380;
  const [shown, faint] = [points.filter((one) => !one.faint), points.filter((one) => one.faint)];
  const y = { type: share ? "linear" : "log", domain: domain.y, label: title };
  const fill = (one) => (one.open ? "var(--background)" : kinds[one.kind]);
  const stroke = (one) => (one.wins ? "currentColor" : one.open ? kinds[one.kind] : "var(--background)");
  const marks = { x: "x", y: "y", r: 5, symbol: (one) => SYMBOLS[one.kind], fill, stroke, strokeWidth: (one) => (one.wins || one.open ? 1.5 : 0.75) };
  const svg = plot({
    width, height, marginLeft: LEFT, marginBottom: BOTTOM, marginRight: RIGHT, marginTop: TOP, y,
    x: { type: "log", domain: domain.x, label: "times as fast as LaPy →" },
    ariaLabel: said,
    marks: [
      gridX({ ticks: 5, strokeOpacity: 0.12 }), gridY({ ticks: 5, strokeOpacity: 0.12 }),
      axisX({ ticks: 5, tickFormat: (v) => `${powers(v)} ×`, tickSize: 3 }), axisY({ ticks: 5, tickFormat: share ? (v) => `${v} %` : powers, tickSize: 3 }),
      ...below,
      dot(faint, { ...marks, fillOpacity: 0.25 }),
      dot(shown, marks),
      tip(shown, pointer({ x: "x", y: "y", title: (one) => `${one.title}\nclick to open its page`, ...TIP })),
    ],
    symbol: { type: "identity" }, color: { type: "identity" },
  });
  label(svg, said);
  svg.classList.add("clickable", "linked");
  svg.addEventListener("click", () => svg.value && open(svg.value.slug));
  svg.addEventListener("input", () => pointAt(svg.value?.slug ?? ""));
  svg.addEventListener("pointerleave", () => pointAt(""));
  svg.points = points.map((one) => ({ slug: one.slug, x: svg.scale("x").apply(one.x), y: svg.scale("y").apply(one.y) }));
  box.append(svg);
  return name(svg, { points, steps }, { left: LEFT + 2, right: width - 4, top: 4, bottom: height - BOTTOM - 2 });
}

/** Write names beside points where there is room, below the tip, the first first; return the points without. */
function name(svg, { points, steps }, frame) {
  const [x, y] = ["x", "y"].map((axis) => svg.scale(axis));
  const measured = document.createElement("canvas").getContext("2d");
  measured.font = `${NAME_SIZE}px ${getComputedStyle(svg).fontFamily}`;
  const corners = steps.map((one) => ({ x: x.apply(one.x), y: y.apply(one.y) }));
  const turn = (one) => (one.first ? 0 : one.faint ? 2 : 1);
  const ordered = [...points].sort((a, b) => turn(a) - turn(b));
  const at = ordered.map((one) => ({ one, x: x.apply(one.x), y: y.apply(one.y), text: one.name, long: measured.measureText(one.name).width, above: one.first }));
  const written = labels(at, frame, stairs(corners)).filter(({ point }) => !point.one.faint || point.one.first);
  for (const { point, x: left, y: middle, anchor, text: title } of written)
    svg.lastElementChild.before(drawn("text", { x: left, y: middle, "text-anchor": anchor, dy: "0.32em", "font-size": NAME_SIZE, fill: "currentColor", class: "name", "data-slug": point.one.slug }, title));
  return ordered.filter((one) => !one.faint && !written.some(({ point }) => point.one === one));
}

/** Return a line of text with a list of names; null without any. */
export const listed = (text, names) =>
  names.length ? element("p", { class: "small" }, element("strong", {}, text), names.join(", "), ".") : null;

/** Return a short line as it is in a chart. */
export const sample = (attributes) =>
  drawn("svg", { width: 22, height: 10, "aria-hidden": "true" }, drawn("line", { x1: 0, x2: 22, y1: 5, y2: 5, ...attributes }));

/** Return what the kinds look like, and more entries. */
export function legend(points, kinds, ...more) {
  const present = Object.keys(kinds).filter((kind) => points.some((one) => one.kind === kind));
  return element("p", { class: "legend" }, present.map((kind) => element("span", {}, mark(kind, kinds), kind)), more.filter(Boolean).map((one) => element("span", {}, ...one)));
}

/** Return a polygon or a line through corners, which may leave the frame. */
export const through = (corners, options) => line(corners, { x: "0", y: "1", clip: true, ...options });
