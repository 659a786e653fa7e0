// Arithmetic of the charts: the points on the Pareto front, and where names go.

/** Return the points that no other is both as fast and as good as, fastest first. */
export function front(points, higher) {
  const sign = higher ? -1 : 1;
  const ordered = [...points].sort((a, b) => a.time - b.time || sign * (a.value - b.value));
  const best = [];
  for (const one of ordered)
    if (!best.length || sign * (one.value - best.at(-1).value) < 0) best.push(one);
  return best;
}

const MARGIN = 5; // pixels by which another point is farther from a name than its own
const HALF = 6.5; // of the height of a name, in pixels
const OFFSETS = [0, 12, -12, 18, -18];
const ABOVE = [-9, 11, 0, -18, 18]; // a name on the front stands clear of its line

/** Return the boxes of a line that goes up or down at each point, then on to the next. */
export const stairs = (corners) =>
  corners.slice(1).flatMap((to, i) => {
    const from = corners[i];
    return [[from.x, Math.min(from.y, to.y), from.x + 1, Math.max(from.y, to.y)], [from.x, to.y, to.x, to.y + 1]];
  });

/**
 * Return where names stand beside points, clear of each other, of all marks and of what else is taken,
 * each nearer to its own point than to any other; a name that fits nowhere is left out. A point has x,
 * y, its text, how long that is in pixels, and whether it stands above.
 */
export function labels(points, frame, lines) {
  const taken = [...lines, ...points.map(({ x, y }) => [x - 5, y - 5, x + 5, y + 5])];
  const written = [];
  for (const point of points) {
    const { x, y, text, long, above } = point;
    for (const [dy, anchor] of (above ? ABOVE : OFFSETS).flatMap((dy) => [[dy, "start"], [dy, "end"]])) {
      const left = anchor === "start" ? x + 8 : x - 8 - long;
      const here = [left, y + dy - HALF, left + long, y + dy + HALF];
      const inside = here[0] >= frame.left && here[2] <= frame.right && here[1] >= frame.top && here[3] <= frame.bottom;
      const near = points.every((other) => other === point || distance(here, other) > distance(here, point) + MARGIN);
      if (!inside || !near || taken.some((other) => overlap(here, other))) continue;
      taken.push(here);
      written.push({ point, x: anchor === "start" ? x + 8 : x - 8, y: y + dy, anchor, text });
      break;
    }
  }
  return written;
}

const overlap = (a, b) => Math.min(a[2], b[2]) > Math.max(a[0], b[0]) && Math.min(a[3], b[3]) > Math.max(a[1], b[1]);

/** Return how far a point is from a box. */
function distance([left, top, right, bottom], { x, y }) {
  return Math.hypot(Math.max(left - x, 0, x - right), Math.max(top - y, 0, y - bottom));
}
