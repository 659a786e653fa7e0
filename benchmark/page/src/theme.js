// Light and dark: as the system says, unless a reader chooses.

const KEY = "eigbench-theme";

/** Wire the select; `changed` is called after every change, the system's too. */
export function wireTheme(select, changed) {
  apply((select.value = stored()));
  select.addEventListener("change", () => {
    apply(select.value);
    store(select.value);
    changed();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}

function apply(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
}

function stored() {
  try {
    return localStorage.getItem(KEY) ?? "";
  } catch {
    return ""; // a page from a file may have no storage
  }
}

function store(theme) {
  try {
    localStorage.setItem(KEY, theme);
  } catch {
    // as above: then the choice holds until the page is left
  }
}
