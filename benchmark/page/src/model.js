// The page of a model: where it stands, why, by families and laws, its shapes, and how to run it again.

import { drawn, element, mark, plainTable } from "./dom.js";
import { charts, get } from "./load.js";
import { difference } from "./numbers.js";
import { makeShapes } from "./shapes.js";
import { encoded, decoded, modelPage } from "./state.js";

const GOOD = 1e-3; // an RPD without a shade; 10 is the largest there is
const WHY = "why"; // the part that a rank's link leads to
const RINGS = [0.25, 0.5, 0.75, 1];

/** Return the page's element, what starts it, and what to call when it is left or the theme changes. */
export function makeModel({ page, board, state, index, choose }) {
  const { model: slug } = state;
  const apart = page.apart[board.key] ?? [];
  const why = element("div", {});
  const beside = element("div", {});
  const opened = element("div", { class: "detail" }, element("p", {}, "Loading …"));
  const badges = element("span", { class: "badges" }, badge("scores recomputed by CI from its predictions"));
  const origin = element("div", {});
  const cite = element("div", {});
  const back = encoded({ ...decoded(""), board: board.key, open: slug });
  const kindOf = new Map(board.rows.map((row) => [row.slug, row.kind]));
  const made = element("div", { style: `--predicted: ${index.kinds[page.kind]}` },
    element("p", {}, element("a", { href: back }, `← ${board.title}`)),
    element("p", {}, mark(page.kind, index.kinds), ` ${page.kind} `, badges),
    standings(page, board.key, slug),
    section("Where it comes from", origin),
    picker(apart, state.other, choose), beside,
    apart.length ? part(WHY, "Why this rank", element("p", { class: "small" }, "The RPD of each other row minus that of this one: the mean and its 95 % interval over shapes and seeds. Left of zero the other row is better. A filled mark is a sure difference, with Holm’s correction, and counts for the rank; an open one is a tie."), why) : null,
    page.families.length ? section("By family", page.families.map((strip) => heat(strip, board.key, slug))) : null,
    page.physics.length ? section("The laws of every spectrum", radar(page.physics)) : null,
    section(`On this board: ${board.title}`, opened),
    again(page, board, cite));
  let shapes = null;
  let closed = false;
  const draw = () => {
    if (apart.length) eigbench.charts.apart(why, apart.map(([other, name, mean, low, high, sure]) => ({ name, kind: kindOf.get(other), mean, low, high, sure })), page.name, index.kinds);
  };
  return {
    element: made,
    start: async () => {
      const ready = charts().then(() => {
        draw();
        if (state.part === WHY) document.getElementById(WHY)?.scrollIntoView();
      });
      const other = state.other && apart.some(([one]) => one === state.other) ? state.other : "";
      const [content, second] = await Promise.all([get(`rows/${board.key}/${slug}`), other ? get(`models/${other}`) : null, ready]
      ).catch((error) => {
        opened.replaceChildren(element("p", { class: "error" }, error.message));
        return [null, null];
      });
      if (closed || !content) return;
      if (second) beside.replaceChildren(sideBySide(page, second, other), familiesBeside(page, second, board));
      shapes = makeShapes(page.name, content);
      if (content.verified) badges.append(" ", badge("run by a maintainer"));
      origin.replaceChildren(facts(content.facts));
      cite.replaceChildren(...entry(content.bibtex));
      opened.replaceChildren(...shapes.elements);
      await shapes.start();
    },
    redraw: () => {
      draw();
      shapes?.redraw();
    },
    close: () => {
      closed = true;
      shapes?.close();
    },
  };
}

const badge = (text) => element("span", { class: "badge" }, text);
const section = (title, ...children) => part(null, title, ...children);
const part = (id, title, ...children) => element("section", { id }, element("h3", {}, title), ...children);

/** The card of ranks: every board the model is on. */
function standings(page, key, slug) {
  const lines = page.standings.map(({ board, dataset, title, rank, of, cells }) =>
    element("tr", { class: board === key ? "open" : null },
      element("th", { scope: "row" }, dataset, ", ",
        element("a", { href: modelPage(board, slug), "aria-current": board === key ? "true" : null }, title)),
      element("td", { class: "number" }, /^\d/.test(rank) ? `${rank} of ${of}` : rank),
      ...cells.map((text) => element("td", { class: "number" }, text))));
  const heads = ["board", "rank", "RPD ↓", "PSNR>20 ↑", "speed against LaPy"];
  return section("Where it stands",
    element("div", { class: "scroll", role: "region", "aria-label": "Where it stands", tabindex: "0" },
      element("table", { class: "plain standings" },
        element("caption", { class: "unseen" }, `${page.name} on every board`),
        element("thead", {}, element("tr", {}, heads.map((title, i) => element("th", { scope: "col", class: i ? "number" : null }, title)))),
        element("tbody", {}, lines))));
}

/** Let a second model be chosen to stand beside this one. */
function picker(apart, other, choose) {
  if (!apart.length) return null;
  const select = element("select", { id: "other", change: () => choose(select.value) },
    [["", "none"], ...[...apart].sort((a, b) => a[1].localeCompare(b[1], "en"))].map(([slug, name]) => element("option", { value: slug, selected: slug === other }, name)));
  return element("p", {}, element("label", { for: "other" }, "Compare with "), select);
}

/** Two models on every board that has both, with their paired difference. */
function sideBySide(page, second, other) {
  const theirs = new Map(second.standings.map((one) => [one.board, one]));
  const rows = page.standings.filter(({ board }) => theirs.has(board) && page.apart[board]).map((mine) => {
    const found = page.apart[mine.board].find(([slug]) => slug === other);
    if (!found) return null;
    const [, , mean, low, high, sure] = found;
    const their = theirs.get(mine.board);
    const apart = mean === null ? "not finite" : `${difference(mean)} (${difference(low)} to ${difference(high)})`;
    const verdict = !sure ? "not decided" : mean < 0 ? second.name : page.name;
    return [`${mine.dataset}, ${mine.title}`, mine.cells[0], their.cells[0], apart, verdict, mine.cells[2], their.cells[2]];
  }).filter(Boolean);
  const headers = ["board", `RPD, ${page.name}`, `RPD, ${second.name}`, "paired difference, 95 %", "better", `speed, ${page.name}`, `speed, ${second.name}`];
  return plainTable({ title: `Beside ${second.name}`, headers, rows });
}

/** Two models' mean RPD of each family of a board; empty where it has no families. */
function familiesBeside(page, second, board) {
  const line = (of) => of.families.flatMap(({ families, lines }) => lines.filter((one) => one.board === board.key).map(({ cells }) => ({ families, cells })))[0];
  const [mine, their] = [line(page), line(second)];
  if (!mine || !their) return "";
  const cells = new Map(their.families.map((family, i) => [family, their.cells[i]]));
  const smaller = (a, b) => (a === b ? "neither" : (a ?? Infinity) < (b ?? Infinity) ? page.name : second.name);
  const rows = mine.families.map((family, i) => [family, mine.cells[i], cells.get(family)]).filter(([, a, b]) => a?.[0] && b?.[0])
    .map(([family, a, b]) => [family, a[0], b[0], smaller(a[1], b[1])]);
  return plainTable({ title: `Families, with ${second.name}`, headers: ["family", `RPD, ${page.name}`, `RPD, ${second.name}`, "smaller"], rows });
}

/** A heat strip: the mean RPD of each family, one line per protocol. */
function heat({ title, families, lines }, key, slug) {
  const shade = (value) => (value === null ? null : `background: rgb(213 94 0 / ${(0.45 * Math.min(1, Math.max(0, Math.log10(Math.max(value, GOOD) / GOOD) / 4))).toFixed(3)})`);
  return element("div", { class: "scroll", role: "region", "aria-label": title, tabindex: "0" },
    element("table", { class: "plain heat" },
      element("caption", {}, `${title}: mean RPD of each family; the stronger the colour, the worse`),
      element("thead", {}, element("tr", {}, element("td"), families.map((name) => element("th", { scope: "col" }, element("span", {}, name))))),
      element("tbody", {}, lines.map((line) => element("tr", { class: line.board === key ? "open" : null },
        element("th", { scope: "row" }, element("a", { href: modelPage(line.board, slug) }, line.title)),
        line.cells.map(([text, value]) => element("td", { class: "number", style: shade(value) }, text)))))));
}

/** How well each law is kept, as a radar and as a list. */
function radar(laws) {
  const [x0, y0, radius] = [210, 120, 90];
  const at = (i, share) => {
    const angle = (2 * Math.PI * i) / laws.length - Math.PI / 2;
    return [x0 + radius * share * Math.cos(angle), y0 + radius * share * Math.sin(angle)];
  };
  const outline = (share) => laws.map((law, i) => at(i, share(law)).map((x) => x.toFixed(1)).join(",")).join(" ");
  const said = `Radar of ${laws.length} laws: ${laws.map(({ title, text }) => `${title} ${text}`).join("; ")}.`;
  const svg = drawn("svg", { viewBox: `0 0 ${2 * x0} ${2 * y0}`, class: "radar", role: "img", "aria-label": said },
    ...RINGS.map((share) => drawn("polygon", { points: outline(() => share), class: "ring" })),
    ...laws.map((_, i) => drawn("line", { x1: x0, y1: y0, x2: at(i, 1)[0], y2: at(i, 1)[1], class: "ring" })),
    drawn("polygon", { points: outline((law) => law.kept), class: "kept" }),
    ...laws.map(({ title }, i) => {
      const [x, y] = at(i, 1.15);
      const anchor = Math.abs(x - x0) < 5 ? "middle" : x > x0 ? "start" : "end";
      return drawn("text", { x, y, "text-anchor": anchor, dy: "0.32em" }, title);
    }));
  const table = plainTable({ title: "Median deviation, or share of spectra", headers: ["law", ""], rows: laws.map(({ title, text }) => [title, text]) }, "h4");
  return element("div", { class: "pair laws" }, element("figure", {}, svg, element("figcaption", {}, "At the rim a law holds to 1e-6, or for every spectrum; at the centre the deviation is as large as the eigenvalues.")), table);
}

/** Who made it, of which files, with what training, and when. */
function facts(entries) {
  const link = ([text, url]) => {
    const href = url ?? (/^https:\/\/\S+$/.test(text) ? text : null);
    return href ? element("a", { href, rel: "noreferrer" }, text) : text;
  };
  const parts = (texts) => texts.flatMap((one, i) => (i ? [", ", link(one)] : [link(one)]));
  return element("dl", { class: "facts" }, entries.map(([title, texts]) => element("div", {}, element("dt", {}, title), element("dd", {}, parts(texts)))));
}

/** How to run it again, cite it and share its page. */
function again(page, board, cite) {
  const command = page.command[board.key];
  return section("Run it again, cite it, share it",
    command ? element("p", {}, "In ", element("code", {}, "baselines/"), ", or where its file lies: ", element("code", { class: "command" }, command)) : null,
    cite,
    element("p", { class: "buttons" }, copier("Copy the link to this page", () => location.href, "The address of this page is its link")));
}

/** An entry of BibTeX, with the address of this page where it is on the web. */
function entry(bibtex) {
  const web = /^https?:$/.test(location.protocol);
  const text = web ? bibtex.replace(/\n\}$/, `\n  url = {${location.href.replaceAll("%", "\\%")}},\n}`) : bibtex;
  return [element("pre", { class: "cite", tabindex: "0", role: "region", "aria-label": "BibTeX" }, text), element("p", { class: "buttons" }, copier("Copy the citation", () => text, "Select the text and copy it"))];
}

/** Return a button that copies a text, and says where a browser forbids it what to do. */
function copier(title, text, otherwise) {
  const button = element("button", { type: "button", click: async () => {
    try {
      await navigator.clipboard.writeText(text());
      button.textContent = "Copied";
    } catch {
      button.textContent = otherwise;
    }
  } }, title);
  return button;
}
