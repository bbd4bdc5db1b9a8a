// Builds the pages of reports: `node build.mjs FOLDER [MODULES]` writes one HTML file each, with all script and style
// inside: report_template.html for a run, sweep_template.html for a sweep, live.html for an arm that `viable live` drives.
// MODULES is the folder that holds node_modules (default: this one).
// The C++ program puts the data of a report where the two placeholders stand; it serves live.html as it is.
import { execFileSync } from 'node:child_process';
import { createHash } from 'node:crypto';
import { mkdir, readFile, writeFile } from 'node:fs/promises';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const folder = dirname(fileURLToPath(import.meta.url));
const target = process.argv[2];
if (!target) {
  console.error('usage: node build.mjs FOLDER [MODULES]');
  process.exit(2);
}
const modules = join(resolve(process.argv[3] ?? folder), 'node_modules');

/** Where the program puts the data of a report. */
const DATA = `<script type="application/json" id="viable-data">@@VIABLE_DATA@@</script>
<script type="text/plain" id="viable-binary">@@VIABLE_BINARY@@</script>
`;

/** The content of an inline element and the hash that lets the content security policy admit it, and nothing else. */
function inline(text) {
  return { text, hash: `'sha256-${createHash('sha256').update(text).digest('base64')}'` };
}

/** The text of a script or a style sheet in the sources with all that it imports. */
function bundle(file) {
  const options = ['--bundle', '--minify', '--format=iife', '--charset=ascii', '--target=chrome109,firefox115,safari16.4'];
  options.push('--legal-comments=none'); // the licences stand whole in the head of the page
  const env = { ...process.env, NODE_PATH: modules };
  const stdio = ['ignore', 'pipe', 'inherit'];
  return execFileSync(process.env.ESBUILD ?? 'esbuild', [file, ...options], { cwd: folder, env, stdio, encoding: 'utf8', maxBuffer: 1e8 }).trim();
}

/**
 * Writes a page from SOURCE/body.html in the frame of all pages, its script and its style; `packages` are those from npm
 * that are in it. A page that is served may speak with its server.
 */
async function buildPage(name, title, source, style, packages, { isServed = false } = {}) {
  const script = inline(bundle(`${source}/main.js`).replace(/<\/script/gi, '<\\/script'));
  const css = inline(bundle(`${source}/${style}`));
  if (/<!--/.test(script.text) || /<\/style/i.test(css.text)) throw new Error('the bundle would break the page');

  const licences = await Promise.all(
    packages.map(async (one) => {
      const text = await readFile(join(modules, one, 'LICENSE'), 'utf8');
      return `${one}\n\n${text.trim()}`;
    }),
  );
  const parts = {
    POLICY:
      `default-src 'none'; script-src ${script.hash}; style-src ${css.hash}; base-uri 'none'; form-action 'none'` +
      (isServed ? "; connect-src 'self'" : ''),
    TITLE: title,
    LICENCES: licences.length > 0 ? `<!-- This page contains:\n\n${licences.join('\n\n').replaceAll('--', '- -')}\n-->\n` : '',
    BODY: await readFile(join(folder, source, 'body.html'), 'utf8'),
    DATA: isServed ? '' : DATA,
    STYLE: css.text,
    SCRIPT: script.text,
  };
  const frame = await readFile(join(folder, 'src/frame.html'), 'utf8');
  const page = frame.replace(/@@([A-Z]+)@@/g, (_, part) => parts[part]);
  for (const placeholder of isServed ? [] : ['@@VIABLE_DATA@@', '@@VIABLE_BINARY@@'])
    if (page.split(placeholder).length !== 2) throw new Error(`${placeholder} must stand in ${name} exactly once`);
  await writeFile(join(target, name), page);
  console.log(`${join(target, name)}: ${Math.round(page.length / 1024)} KB`);
}

await mkdir(target, { recursive: true });
await buildPage('report_template.html', 'viable report', 'src', 'run.css', ['three', 'uplot']);
await buildPage('sweep_template.html', 'viable sweep', 'src/sweep', 'sweep.css', []);
await buildPage('live.html', 'viable live', 'src/live', 'live.css', ['three'], { isServed: true });
