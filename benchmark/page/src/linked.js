// What belongs to a row stands out together: its line of the table, and its point in every chart.

import { drawn } from "./dom.js";

/** Let a row stand out wherever it is; none without a name. */
export function point(slug) {
  for (const row of document.querySelectorAll("tr.pointed")) row.classList.remove("pointed");
  if (slug) document.getElementById(`row-${slug}`)?.classList.add("pointed");
  for (const svg of document.querySelectorAll("svg.linked")) {
    const at = svg.points.find((one) => one.slug === slug);
    svg.querySelector(".halo")?.remove();
    if (at) svg.append(drawn("circle", { class: "halo", cx: at.x, cy: at.y, r: 9 }));
  }
}

/** Let a row of the table point at what belongs to it. */
export function wirePointing(row, slug) {
  row.addEventListener("pointerenter", () => point(slug));
  row.addEventListener("pointerleave", () => point(""));
}
