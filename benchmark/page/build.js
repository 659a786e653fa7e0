// Bundles the page's scripts and styles into dist/, and gathers the licences of what is in them.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { copyFile, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";

const here = path.dirname(fileURLToPath(import.meta.url));
const from = (...parts) => path.join(here, ...parts);

await rm(from("dist"), { recursive: true, force: true });
await mkdir(from("dist"));
const { metafile } = await build({
  entryPoints: ["page.js", "chart.js", "viewer.js", "style.css"].map((name) => from("src", name)),
  outdir: from("dist"),
  absWorkingDir: here, // paths in the report below are relative to it
  bundle: true,
  minify: true,
  format: "iife", // a page opened from a file can load no modules
  target: "es2022",
  charset: "utf8",
  legalComments: "none", // LICENSES.txt has them
  metafile: true,
});
await copyFile(from("src", "index.html"), from("dist", "index.html"));

const { dependencies: wanted } = JSON.parse(await readFile(from("package.json"), "utf8"));
const bundled = new Set();
for (const { inputs } of Object.values(metafile.outputs)) {
  for (const [input, { bytesInOutput }] of Object.entries(inputs)) {
    const match = input.match(/^node_modules\/((?:@[^/]+\/)?[^/]+)\//);
    if (match && bytesInOutput) bundled.add(match[1]);
  }
}
for (const name of Object.keys(wanted))
  if (!bundled.has(name)) throw new Error(`nothing of ${name} is in the bundle`);
const parts = [];
for (const name of [...bundled].sort()) {
  const folder = from("node_modules", name);
  const { version, license } = JSON.parse(await readFile(path.join(folder, "package.json"), "utf8"));
  const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
  if (!file && !license) throw new Error(`${name} ${version} says nothing of its licence`);
  const text = file ? await readFile(path.join(folder, file), "utf8") : "(no licence file in the package)";
  parts.push(`${name} ${version} (${license})\n\n${text.trim()}\n`);
}
await writeFile(
  from("dist", "LICENSES.txt"),
  `The scripts of this page contain these packages.\n\n${parts.join(`\n${"-".repeat(72)}\n\n`)}`,
);

// What it was made from: `eigbench site` refuses a bundle of other sources.
const sources = ["build.js", "package.json", "package-lock.json"];
for (const entry of await readdir(from("src"), { withFileTypes: true }))
  if (entry.isFile() && !entry.name.startsWith(".")) sources.push(`src/${entry.name}`);
const digests = await Promise.all(sources.map(async (name) => createHash("sha256").update(await readFile(from(name))).digest("hex")));
await writeFile(from("dist", "SOURCES.sha256"), sources.map((name, i) => `${digests[i]}  ${name}\n`).join(""));
