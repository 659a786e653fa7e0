// What a column says of itself, beside its head while that is pointed at or has the focus. Screen
// readers have the same text by aria-describedby; the list below the table has all of them.

/** Let an element show a text. */
export function wireTip(target, text) {
  target.addEventListener("pointerenter", () => show(target, text));
  target.addEventListener("pointerleave", (event) => {
    if (!box().contains(event.relatedTarget)) hide();
  });
  target.addEventListener("focusin", () => show(target, text));
  target.addEventListener("focusout", hide);
}

/** Wire what belongs to the page as a whole. */
export function wirePage() {
  addEventListener("keydown", (event) => event.key === "Escape" && hide());
  addEventListener("scroll", scrolled, { capture: true, passive: true }); // of the table too
  box().addEventListener("pointerleave", hide);
}

/** Hide the tip. */
export function hide() {
  box().hidden = true;
  shown = null;
}

let shown = null; // the element that it is of

/** A head that gets the focus may scroll into view, and keeps its tip; all others lose it. */
function scrolled() {
  if (!shown) return;
  const { top, bottom } = shown.getBoundingClientRect();
  if (shown.contains(document.activeElement) && bottom > 0 && top < innerHeight) position(shown);
  else hide();
}

const box = () => document.getElementById("tip");

function show(target, text) {
  box().textContent = text;
  box().hidden = false;
  shown = target;
  position(target);
}

function position(target) {
  const at = target.getBoundingClientRect();
  const { width, height } = box().getBoundingClientRect();
  const left = Math.max(8, Math.min(at.left, document.documentElement.clientWidth - width - 8));
  const below = at.bottom + height + 8 < innerHeight;
  box().style.left = `${left}px`;
  box().style.top = `${below ? at.bottom : Math.max(0, at.top - height)}px`;
}

