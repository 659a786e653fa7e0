// Data comes as scripts that call eigbench.put: from a file nothing else can be loaded.

const known = new Map();
const waiting = new Map();

/** Take a value; called by the scripts of data. */
export function put(key, value) {
  known.set(key, value);
  waiting.get(key)?.resolve(value);
  waiting.delete(key);
}

/** Return whether a value was put. */
export const has = (key) => known.has(key);

/** Return what is said of a file that is not there. */
export const lost = (path) => new Error(`${path} of this page's folder cannot be loaded`);

/** Return a promise of the value of KEY.js. */
export function get(key) {
  if (known.has(key)) return Promise.resolve(known.get(key));
  if (!waiting.has(key)) {
    const promise = Promise.withResolvers ? Promise.withResolvers() : withResolvers();
    waiting.set(key, promise);
    if (key !== "index")
      script(`${key}.js`).catch((error) => {
        waiting.delete(key); // so that it is tried again
        promise.reject(error);
      });
  }
  return waiting.get(key).promise;
}

function withResolvers() {
  const made = {};
  made.promise = new Promise((resolve, reject) => Object.assign(made, { resolve, reject }));
  return made;
}

const scripts = new Map();

/** Load a script of the page's folder, once. */
export function script(path) {
  if (!scripts.has(path)) {
    scripts.set(path, new Promise((resolve, reject) => {
      const tag = document.createElement("script");
      tag.src = path;
      tag.onload = resolve;
      tag.onerror = () => {
        scripts.delete(path);
        reject(lost(path));
      };
      document.head.append(tag);
    }));
  }
  return scripts.get(path);
}

/** Return a promise of the charts, which the first table does without. */
export const charts = () => script("chart.js").then(() => eigbench.charts);
