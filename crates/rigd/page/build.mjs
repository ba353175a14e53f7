// Builds the page into dist/, the same bytes for the same sources and the same package-lock.json.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { copyFileSync, mkdirSync, readFileSync, readdirSync } from "node:fs";

const out = process.argv[2] ?? "dist";
mkdirSync(out, { recursive: true });
// What tells a tab with these sources from one with others.
const sources = createHash("sha256");
for (const file of readdirSync("src").sort()) if (!file.includes(".test.")) sources.update(readFileSync(`src/${file}`));
await build({
  entryPoints: { page: "src/main.tsx" },
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "inline",
  charset: "utf8",
  define: { BUILD: JSON.stringify(sources.digest("hex").slice(0, 16)) },
});
for (const file of ["index.html", "icon.svg"]) copyFileSync(`src/${file}`, `${out}/${file}`);
