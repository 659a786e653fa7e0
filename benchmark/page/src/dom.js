// Elements and text. Nothing here takes HTML: names and texts of results stay text.

/** Return an element; attributes with a function listen, those that are null or false are left out. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value !== null && value !== undefined && value !== false)
      made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return made;
}

// What is escaped comes first, so that it neither begins nor ends anything
const INLINE = /\\[\\|`*[\]!]|\*\*((?:\\.|[^\\])+?)\*\*|\[((?:\\.|[^\]\\])+)\]\(([^)\s]+)\)|`([^`]+)`/g;

/** Return the nodes of a line of Markdown: bold, links, code. */
function inline(text, link) {
  const nodes = [];
  let end = 0;
  for (const match of text.matchAll(INLINE)) {
    nodes.push(plain(text.slice(end, match.index)));
    const [, bold, title, target, code] = match;
    if (bold) nodes.push(element("strong", {}, inline(bold, link)));
    else if (code) nodes.push(element("code", {}, code));
    else if (title && link(target)) nodes.push(element("a", { href: link(target) }, plain(title)));
    else nodes.push(plain(title ?? match[0]));
    end = match.index + match[0].length;
  }
  nodes.push(plain(text.slice(end)));
  return nodes;
}

/** Undo what the Markdown of LEADERBOARD.md escapes. */
function plain(text) {
  return text.replace(/\\([\\|`*[\]!])/g, "$1").replaceAll("&lt;", "<");
}

/** Return the paragraphs and lists of some Markdown. */
export function markdown(texts, link) {
  const blocks = [];
  let list = null;
  for (const line of texts.flatMap((text) => text.split("\n"))) {
    if (line.startsWith("- ")) {
      list ??= blocks[blocks.push(element("ul")) - 1];
      list.append(element("li", {}, inline(line.slice(2), link)));
    } else if (line) {
      list = null;
      blocks.push(element("p", {}, inline(line, link)));
    }
  }
  return blocks;
}

/**
 * Return a function from a target in the repository, docs/labels.md#part, to a link to that page
 * of docs. Others must be https:, and are null if not.
 */
export function linker(pattern) {
  return (target) => {
    const match = target.match(/^docs\/([\w.-]+)\.md(#.*)?$/);
    return match ? pattern.replace("{}", match[1]) + (match[2] ?? "") : /^https:\/\//.test(target) ? target : null;
  };
}

/** Return the first page of the site or checkout whose docs these are; null where they lie elsewhere. */
export const first = (pattern) =>
  pattern.endsWith("docs/{}.html") ? pattern.replace("docs/{}", "index") : pattern.endsWith("docs/{}.md") ? pattern.replace("docs/{}", "README") : null;

/** Return a labelled table of texts that scrolls by itself where it is too wide. */
export function plainTable({ title, headers, rows }, heading = "h3") {
  const wide = headers.length > 3;
  const head = headers.some(Boolean)
    ? element("thead", {}, element("tr", {}, headers.map((text, i) =>
        text ? element("th", { scope: "col", class: i ? "number" : null }, text) : element("td"))))
    : null;
  const body = element("tbody", {}, rows.map((cells) => element("tr", {}, cells.map((text, i) =>
    element(i ? "td" : "th", i ? { class: headers.some(Boolean) ? "number" : "words" } : { scope: "row" }, text)))));
  const table = element("table", { class: "plain" }, element("caption", { class: "unseen" }, title), head, body);
  return element("section", {},
    element(heading, {}, title),
    element("div", { class: "scroll", role: "region", "aria-label": title, tabindex: wide ? "0" : null }, table));
}

const SVG = "http://www.w3.org/2000/svg";

/** Return an element of a picture. */
export function drawn(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const MARKS = {
  trivial: ["rect", { x: 1.5, y: 1.5, width: 9, height: 9 }],
  classical: ["circle", { cx: 6, cy: 6, r: 5 }],
  learned: ["path", { d: "M6 0.8 11.4 10.6H0.6Z" }],
};

/** Return the mark of a kind, as in the charts. */
export function mark(kind, colours) {
  const [tag, attributes] = MARKS[kind];
  return drawn("svg", { class: "mark", viewBox: "0 0 12 12", width: 12, height: 12, "aria-hidden": "true" },
    drawn(tag, { ...attributes, fill: colours[kind] }));
}
