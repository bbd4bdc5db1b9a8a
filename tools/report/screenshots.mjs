// Takes small pictures of a report, for documents:
//   node screenshots.mjs REPORT PICTURE.png [--plots position,jerk] [--joint 0] [--cases S1,S4] [--from 0] [--to 8]
//     [--height 130] [--title TEXT] [--width 760] [--scale 1.2] [--modules FOLDER]
//   node screenshots.mjs REPORT PICTURE.png --replay TIME [--case NAME] [--deviation 10] [--height 420] ...
//   node screenshots.mjs REPORT PICTURE.png --sweep RESULT [--scatters 3] ...: of a sweep, from the verdicts to the
//     strongest dependences
//   node screenshots.mjs REPORT PICTURE.png --verification [--from 4] [--to 6] ...: the section of `viable verify`
// FOLDER holds node_modules (default: this one). The pictures have few colours (--colours), which keeps them small: this needs
// Debian's package pngquant (apt-get install pngquant).
import { execFileSync } from 'node:child_process';
import { writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';

const text = { type: 'string' };
const {
  positionals: [report, target],
  values: options,
} = parseArgs({
  allowPositionals: true,
  options: {
    plots: { ...text, default: 'position,velocity,acceleration,jerk' },
    joint: { ...text, default: '0' },
    cases: text,
    from: text,
    to: text,
    title: text,
    replay: text,
    sweep: text,
    scatters: { ...text, default: '3' },
    case: text,
    verification: { type: 'boolean', default: false },
    deviation: { ...text, default: '1' },
    width: { ...text, default: '760' },
    height: text,
    scale: { ...text, default: '1.2' },
    colours: text,
    modules: { ...text, default: dirname(fileURLToPath(import.meta.url)) },
  },
});
if (!target) {
  console.error('usage: node screenshots.mjs REPORT PICTURE.png [options]; the options stand at the top of this file');
  process.exit(2);
}
const { chromium } = createRequire(join(resolve(options.modules), 'node_modules/any.js'))('playwright-core');
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--enable-unsafe-swiftshader', '--use-gl=angle', '--use-angle=swiftshader'],
});
const context = await browser.newContext({
  viewport: { width: Number(options.width), height: 900 },
  deviceScaleFactor: Number(options.scale),
  colorScheme: 'light',
});
const page = await context.newPage();
await page.goto(pathToFileURL(resolve(report)).href);
await page.waitForFunction(() => window.viableReport || window.viableSweep);

/** A figure as the page saves it, with other plots, cases or times. */
async function takeFigure() {
  const number = (value) => (value === undefined ? undefined : Number(value));
  const svg = await page.evaluate((wishes) => window.viableReport.figure(wishes), {
    quantities: options.plots.split(','),
    joint: Number(options.joint),
    cases: options.cases?.split(','),
    from: number(options.from),
    to: number(options.to),
    title: options.title,
    width: Number(options.width),
    plotHeight: number(options.height),
    hidden: ['real_q', 'real_qd', 'real_qdd'],
  });
  const paper = await context.newPage();
  await paper.setContent(`<style>body { margin: 0 } svg { display: block }</style>${svg}`);
  return paper.locator('svg').screenshot();
}

/** The arm at a time. */
async function takeReplay() {
  const stage = page.locator('.stage');
  await page.evaluate(
    ({ height, name, deviation, time }) => {
      const { state } = window.viableReport;
      document.querySelector('#side').style.setProperty('display', 'block');
      document.querySelector('.stage').style.setProperty('height', `${height}px`);
      const chosen = state.run.cases.find((c) => c.name === name);
      if (chosen) state.set('replay', { replayCase: chosen.index });
      state.set('replay', { exaggeration: deviation });
      state.setTime(time);
    },
    {
      height: Number(options.height ?? 420),
      name: options.case,
      deviation: Number(options.deviation),
      time: Number(options.replay),
    },
  );
  await stage.scrollIntoViewIfNeeded();
  await page.waitForTimeout(1500); // for the picture in the new size
  const bars = page.locator('#toolbar, #transport');
  await bars.evaluateAll((all) => all.forEach((bar) => bar.style.setProperty('visibility', 'hidden')));
  return stage.screenshot();
}

/** The upper part of a sweep's report, for a result. */
async function takeSweep() {
  await page.getByLabel('Result', { exact: true }).selectOption(options.sweep);
  const last = page.locator('.scatters figure').nth(Number(options.scatters) - 1);
  const bottom = await last.evaluate((root) => root.getBoundingClientRect().bottom + scrollY);
  await page.setViewportSize({ width: Number(options.width), height: Math.ceil(bottom + 12) });
  await page.locator('#toolbar').evaluate((bar) => bar.style.setProperty('display', 'none'));
  await page.waitForTimeout(1000); // for the pictures in the new size
  const top = await page.locator('#head').evaluate((root) => root.getBoundingClientRect().top);
  const end = await last.evaluate((root) => root.getBoundingClientRect().bottom);
  const clip = { x: 0, y: Math.max(0, top - 8), width: Number(options.width), height: Math.ceil(end - top + 13) };
  return page.screenshot({ clip });
}

/** The verdicts and the plot of the worst, over a part of the time. */
async function takeVerification() {
  const view = [Number(options.from), Number(options.to)];
  if (options.from !== undefined) await page.evaluate((times) => window.viableReport.state.setView(...times), view);
  const bars = page.locator('#toolbar, #transport');
  await bars.evaluateAll((all) => all.forEach((bar) => bar.style.setProperty('display', 'none')));
  await page.waitForTimeout(1000); // for the plot
  return page.locator('#verification').screenshot();
}

const take = options.verification ? takeVerification : options.sweep !== undefined ? takeSweep : options.replay !== undefined ? takeReplay : takeFigure;
const colours = options.colours ?? (take === takeFigure ? 64 : 160);
const png = execFileSync('pngquant', ['--nofs', '--speed=1', '--strip', String(colours), '-'], { input: await take(), maxBuffer: 1e8 });
await writeFile(target, png);
console.log(`${target}: ${png.readUInt32BE(16)} x ${png.readUInt32BE(20)}, ${(png.length / 1024).toFixed(0)} KB`);
await browser.close();
