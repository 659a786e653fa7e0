// Numbers as text, on all charts and pages alike.

/** Return a number in two digits, a very small or large one by its power of ten. */
export const powers = (value) => (value === 0 || (value >= 1e-3 && value < 1e5) ? String(+value.toPrecision(2)) : value.toExponential(0));

/** Return a difference with its sign. */
export const signed = (value) => (value === null ? "?" : value === 0 ? "0" : `${value > 0 ? "+" : "−"}${powers(Math.abs(value))}`);

/** Return a difference of scores with its sign, in four decimals as the scores beside it. */
export const difference = (value) => (value === null ? "?" : Math.abs(value) < 5e-5 ? "±0" : `${value > 0 ? "+" : "−"}${Math.abs(value).toFixed(4)}`);

/** Return an integer with its thousands apart. */
export const thousands = (value) => value.toLocaleString("en");

/** Return how many times one is faster than another. */
export const faster = (ratio) => `${thousands(+ratio.toPrecision(2))} ×`;
