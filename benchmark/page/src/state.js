// What is shown, as the fragment of the address: a view can be linked, and Back leads to the one before.

const TEXTS = ["columns", "sort", "training", "setting", "find", "open", "metric", "model", "other", "part"];

/** Return the state of a fragment; what it does not name is empty. */
export function decoded(hash) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const state = { board: given.get("board") ?? "", down: given.get("order") === "down" };
  for (const name of TEXTS) state[name] = given.get(name) ?? "";
  state.kinds = given.has("kinds") ? given.get("kinds").split(",").filter(Boolean) : null; // null: all
  return state;
}

/** Return the fragment of a state, with what is not as it is at first. */
export function encoded(state) {
  const fragment = new URLSearchParams({ board: state.board });
  for (const name of TEXTS) if (state[name]) fragment.set(name, state[name]);
  if (state.sort && state.down) fragment.set("order", "down");
  if (state.kinds) fragment.set("kinds", state.kinds.join(","));
  return `#${fragment}`;
}

/** Return the fragment of a model's page, beside another, or at a part of it. */
export const modelPage = (board, model, { other = "", part = "" } = {}) => encoded({ ...decoded(""), board, model, other, part });
