// Builds the report template: `node build.mjs FILE [MODULES]` writes one HTML file with all script and style inside.
// MODULES is the folder that holds node_modules (default: this one).
// The C++ program puts the data of a run where the two placeholders stand.
import { createHash } from 'node:crypto';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const folder = dirname(fileURLToPath(import.meta.url));
const target = process.argv[2];
if (!target) {
  console.error('usage: node build.mjs FILE [MODULES]');
  process.exit(2);
}
const modules = join(resolve(process.argv[3] ?? folder), 'node_modules');
const { build } = createRequire(join(modules, 'any.js'))('esbuild');

/** The content of an inline element and the hash that lets the content security policy admit it, and nothing else. */
function inline(text) {
  return { text, hash: `'sha256-${createHash('sha256').update(text).digest('base64')}'` };
}

const bundle = await build({
  absWorkingDir: folder,
  nodePaths: [modules],
  entryPoints: ['src/main.js', 'src/style.css'],
  outdir: 'build',
  write: false,
  bundle: true,
  minify: true,
  format: 'iife',
  charset: 'ascii',
  legalComments: 'none', // the licences stand whole in the head of the page
  target: ['chrome109', 'firefox115', 'safari16.4'],
});
const output = (extension) => bundle.outputFiles.find((file) => file.path.endsWith(extension)).text.trim();
const script = inline(output('.js').replace(/<\/script/gi, '<\\/script'));
const style = inline(output('.css'));
if (/<!--/.test(script.text) || /<\/style/i.test(style.text)) throw new Error('the bundle would break the page');

const licences = await Promise.all(
  ['three', 'uplot'].map(async (name) => {
    const text = await readFile(join(modules, name, 'LICENSE'), 'utf8');
    return `${name}\n\n${text.trim()}`;
  }),
);
const parts = {
  POLICY: `default-src 'none'; script-src ${script.hash}; style-src ${style.hash}; base-uri 'none'; form-action 'none'`,
  LICENCES: licences.join('\n\n').replaceAll('--', '- -'),
  STYLE: style.text,
  SCRIPT: script.text,
};
const page = (await readFile(join(folder, 'src/index.html'), 'utf8')).replace(
  /@@(POLICY|LICENCES|STYLE|SCRIPT)@@/g,
  (_, name) => parts[name],
);
for (const placeholder of ['@@VIABLE_DATA@@', '@@VIABLE_BINARY@@'])
  if (page.split(placeholder).length !== 2) throw new Error(`${placeholder} must stand in the page exactly once`);

await mkdir(dirname(resolve(target)), { recursive: true });
await writeFile(target, page);
console.log(`${target}: ${Math.round(page.length / 1024)} KB`);
