// The table of a board: which columns, and in which order the rows.

import { element, mark } from "./dom.js";
import { modelPage } from "./state.js";
import { wirePointing } from "./linked.js";
import { hide, wireTip } from "./tip.js";

const NAME = { title: "model", help: "Its name leads to its page: where it stands on every board, errors by family and eigenvalue, physics, cost, and its worst and median shape.", numeric: false, higher: false };

/** Return what a column is called and how it sorts. */
export const column = (board, key) => (key === "name" ? NAME : board.columns[key]);

/** Return the group of columns of a state, the first if it names none. */
export const groupOf = (board, state) =>
  board.groups.find((group) => group.key === state.columns) ?? board.groups[0];

const isColumn = (board, key) => key === "name" || Object.hasOwn(board.columns, key);

/** Return whether a board has the columns that a state needs; those of other views are loaded when asked for. */
export const isWhole = (board, state) =>
  !board.rest || ((!state.columns || groupOf(board, state).columns.every((key) => isColumn(board, key))) && (!state.sort || isColumn(board, state.sort)));

/** Return a state without what its board does not have: a linked view may be older than the page. */
export function known(board, state, metrics) {
  const { rows } = board;
  const of = (key) => (rows.some((row) => row[key] === state[key]) ? state[key] : "");
  const present = new Set(rows.map((row) => row.kind));
  const kinds = state.kinds?.filter((kind) => present.has(kind)) ?? null;
  const isSorted = isColumn(board, state.sort);
  return {
    ...state,
    columns: board.groups.some(({ key }) => key === state.columns) ? state.columns : "",
    sort: isSorted ? state.sort : "",
    down: isSorted && state.down,
    training: of("training"),
    setting: of("setting"),
    open: rows.some(({ slug }) => slug === state.open) ? state.open : "",
    metric: Object.hasOwn(metrics, state.metric) ? state.metric : "",
    kinds: state.kinds?.length && !kinds.length ? null : kinds, // none of them is here: all are shown
  };
}

/** Return the key that the rows are sorted by; empty for the order of the board. */
export function sortKey(board, state) {
  if (isColumn(board, state.sort)) return state.sort;
  return "rank" in board.columns ? "rank" : "";
}

/** Return the columns to show. */
export const columnsShown = (board, state) =>
  [...("rank" in board.columns ? ["rank"] : []), "name", ...groupOf(board, state).columns];

/** Return the rows that the filters leave, in order. */
export function rowsShown(board, state) {
  const find = state.find.trim().toLowerCase();
  const left = board.rows.filter((row) =>
    (!state.kinds || state.kinds.includes(row.kind)) &&
    (!state.training || row.training === state.training) &&
    (!state.setting || row.setting === state.setting) &&
    (!find || row.name.toLowerCase().includes(find)));
  const key = sortKey(board, state);
  if (!key) return left;
  const value = (row) => (key === "name" ? row.name : row.cells[key][1]);
  const sign = state.down ? -1 : 1;
  return left.sort((a, b) => {
    const [x, y] = [value(a), value(b)];
    if (x === null || y === null) return (x === null) - (y === null);
    return sign * (typeof x === "string" ? x.localeCompare(y, "en") : x - y);
  });
}

/** Return the state after a click on a column's head. */
export function sorted(board, state, key) {
  const same = sortKey(board, state) === key;
  return { sort: key, down: same ? !state.down : column(board, key).higher };
}

/** Fill a container with the table; on a narrow screen its rows are cards. */
export function renderTable(container, board, state, { rows, narrow, kinds, sort }) {
  const keys = columnsShown(board, state);
  const key = sortKey(board, state);
  const focus = container.contains(document.activeElement) ? document.activeElement.id : "";
  const head = keys.map((name) => headCell(board, state, name, name === key, sort));
  const body = rows.map((row, i) => {
    const cells = keys.map((name) => (name === "name" ? nameCell(board, row, kinds) : cell(board, row, name)));
    const begins = key === "rank" && i > 0 && row.cells.rank[1] !== rows[i - 1].cells.rank[1];
    const is = [row.slug === state.open && "open", begins && "begins"].filter(Boolean).join(" ");
    const made = element("tr", { id: `row-${row.slug}`, class: is || null }, cells);
    wirePointing(made, row.slug);
    return made;
  });
  if (!rows.length) body.push(element("tr", {}, element("td", { colspan: keys.length, class: "none" }, "No row passes the filters.")));
  hide();
  const table = element("table", {},
    element("caption", { class: "unseen" }, `${board.title}: ${groupOf(board, state).title}`),
    element("thead", {}, element("tr", {}, head)),
    element("tbody", {}, body));
  const frame = element("div", { class: "board", role: "region", "aria-label": board.title }, table);
  container.replaceChildren(frame);
  if (!narrow && table.scrollWidth > frame.clientWidth) { // it scrolls by itself; else its head sticks to the window
    frame.classList.add("scroll", "wide");
    frame.tabIndex = 0;
    const rank = table.querySelector("th.rank");
    if (rank) frame.style.setProperty("--after-rank", `${rank.offsetWidth}px`);
    keepHead(container);
  }
  if (focus) document.getElementById(focus)?.focus({ preventScroll: true });
}

/** Keep the head of a table that scrolls sideways in the window: sticky would be so within its frame alone. */
export function keepHead(container) {
  const frame = container.querySelector(".board.wide");
  if (!frame) return;
  const head = frame.querySelector("thead");
  const room = frame.clientHeight - head.offsetHeight;
  head.style.transform = `translateY(${Math.min(Math.max(0, -frame.getBoundingClientRect().top), Math.max(0, room))}px)`;
}

function headCell(board, state, key, isSorted, sort) {
  const { title, help, numeric } = column(board, key);
  const arrow = isSorted ? (state.down ? "▼" : "▲") : "";
  const made = element("th", {
    scope: "col",
    class: key === "name" ? "name" : key === "rank" ? "rank" : numeric ? "number" : null,
    "aria-sort": isSorted ? (state.down ? "descending" : "ascending") : null,
  }, element("button", { type: "button", id: `sort-${key}`, class: "sort", "aria-describedby": `help-${key}`, click: () => sort(key) },
    title, element("span", { class: "arrow", "aria-hidden": "true" }, arrow)));
  wireTip(made, help);
  return made;
}

function nameCell(board, row, kinds) {
  return element("th", { scope: "row", class: "name" },
    mark(row.kind, kinds), " ",
    element("a", { class: "title", href: modelPage(board.key, row.slug) }, row.name), " ",
    element("span", { class: "kind" }, row.kind));
}

function cell(board, row, key) {
  const { numeric, title } = board.columns[key];
  const text = row.cells[key][0];
  if (key === "rank")
    return element("td", { class: "rank", "data-title": title }, text, " ",
      element("a", { class: "why", href: modelPage(board.key, row.slug, { part: "why" }), "aria-label": `why ${text}: ${row.name} against every other row` }, "why"));
  const is = numeric ? "number" : `words ${key}`;
  return element("td", { class: is, "data-title": title }, numeric ? uncertain(text) : text);
}

/** Set the uncertainty of a number apart: 0.0119 ± 0.0019 (0.0001). */
function uncertain(text) {
  const match = text.match(/^(.+?)( ± (?:< )?\S+)?( \(.+\).*)?$/);
  if (!match?.[2] && !match?.[3]) return text;
  return [match[1], match[2] && element("span", { class: "spread" }, match[2]), match[3] && element("span", { class: "seeds" }, match[3])];
}

/** Return the list of what the columns mean, which loads the rest of them when it is opened. */
export const glossary = (board, complete) =>
  element("details", { toggle: complete }, element("summary", {}, "What the columns mean"), meanings(board));

/** Return what the columns of a board mean, as far as it has them. */
export function meanings(board) {
  const entries = ["name", ...Object.keys(board.columns)].map((key) => {
    const { title, help } = column(board, key);
    return element("div", {}, element("dt", {}, title), element("dd", { id: `help-${key}` }, help));
  });
  return element("dl", { class: "glossary" }, entries);
}
