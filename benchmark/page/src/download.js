// A board as a file: the table as it is shown, made in the browser, so that no copy can be out of date.

import { element } from "./dom.js";

/** Fill a paragraph with links to the shown rows as CSV and JSON; the board is completed before. */
export function renderDownloads(container, board, { rows, complete }) {
  const link = (kind, type, make) => element("button", { type: "button", class: "link", click: async () => {
    await complete();
    save(`${board.key}.${kind}`, type, make());
  } }, kind.toUpperCase());
  container.replaceChildren("Download these rows, with all columns: ",
    link("csv", "text/csv", () => csv(board, rows)), " ",
    link("json", "application/json", () => `${JSON.stringify(json(board, rows), null, 1)}\n`), " · ",
    element("button", { type: "button", class: "link", click: () => document.getElementById("chart").scrollIntoView() }, "To the chart"));
}

/** Return rows as CSV, RFC 4180: each column as it is shown, and the number behind it where there is one. */
function csv(board, rows) {
  const columns = Object.entries(board.columns);
  const head = ["model", "kind", ...columns.flatMap(([key, { numeric }]) => (numeric ? [key, `${key}-shown`] : [key]))];
  const lines = rows.map((row) => [row.name, row.kind, ...columns.flatMap(([key, { numeric }]) => {
    const [text, value] = row.cells[key];
    return numeric ? [value ?? "", text] : [text];
  })]);
  return [head, ...lines].map((cells) => cells.map(quoted).join(",")).join("\r\n") + "\r\n";
}

const quoted = (cell) => (/[",\r\n]/.test(String(cell)) ? `"${String(cell).replaceAll('"', '""')}"` : String(cell));

function json(board, rows) {
  const numbers = (row) => Object.fromEntries(Object.entries(row.cells).map(([key, [shown, value]]) => [key, { shown, value }]));
  return { board: board.key, title: board.title, rows: rows.map((row) => ({ model: row.name, kind: row.kind, ...numbers(row) })) };
}

function save(name, type, text) {
  const url = URL.createObjectURL(new Blob([text], { type: `${type};charset=utf-8` }));
  element("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
