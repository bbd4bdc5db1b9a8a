// Takes small pictures of a report, for documents:
//   node screenshots.mjs REPORT PICTURE.png [--plots position,jerk] [--joint 0] [--cases S1,S4] [--from 0] [--to 8]
//     [--height 130] [--title TEXT] [--width 760] [--scale 1.2] [--modules FOLDER]
//   node screenshots.mjs REPORT PICTURE.png --replay TIME [--case NAME] [--deviation 10] [--height 420] ...
//   node screenshots.mjs REPORT PICTURE.png --sweep RESULT [--scatters 3] ...: of a sweep, from the verdicts to the
//     strongest dependences
//   node screenshots.mjs REPORT PICTURE.png --verification [--from 4] [--to 6] ...: the section of `viable verify`
// FOLDER holds node_modules (default: this one). The pictures have few colours (--colours), which keeps them small.
import { writeFile } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';
import { deflateSync } from 'node:zlib';

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

/** The pixels of a PNG. */
async function decode(png) {
  const [width, height, base64] = await page.evaluate(async (data) => {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes]));
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d');
    canvas.drawImage(bitmap, 0, 0);
    const { data: pixels } = canvas.getImageData(0, 0, bitmap.width, bitmap.height);
    let binary = '';
    for (let at = 0; at < pixels.length; at += 32768) binary += String.fromCharCode(...pixels.subarray(at, at + 32768));
    return [bitmap.width, bitmap.height, btoa(binary)];
  }, png.toString('base64'));
  return { width, height, pixels: Buffer.from(base64, 'base64') };
}

/** At most `count` colours for a picture: the frequent ones as they are, the rest by median cut. */
function makePalette(pixels, count) {
  const frequency = new Map();
  for (let i = 0; i < pixels.length; i += 4) {
    const key = pixels.readUIntBE(i, 3);
    frequency.set(key, (frequency.get(key) ?? 0) + 1);
  }
  const all = [...frequency].map(([key, n]) => ({ rgb: [key >> 16, (key >> 8) & 255, key & 255], n }));
  all.sort((a, b) => b.n - a.n);
  const palette = all.slice(0, Math.min(count / 4, all.length)).map(({ rgb }) => rgb);
  let boxes = [all.slice(palette.length)].filter((box) => box.length > 0);
  const spread = (box, k) => Math.max(...box.map(({ rgb }) => rgb[k])) - Math.min(...box.map(({ rgb }) => rgb[k]));
  const widest = (box) => [0, 1, 2].map((k) => [spread(box, k), k]).sort((a, b) => b[0] - a[0])[0];
  const weight = (box) => widest(box)[0] * Math.sqrt(box.reduce((sum, { n }) => sum + n, 0));
  while (boxes.length > 0 && palette.length + boxes.length < count) {
    boxes.sort((a, b) => weight(b) - weight(a));
    const [box] = boxes;
    if (box.length < 2) break;
    const [, k] = widest(box);
    box.sort((a, b) => a.rgb[k] - b.rgb[k]);
    const half = box.reduce((sum, { n }) => sum + n, 0) / 2;
    let sum = 0;
    let cut = box.findIndex(({ n }) => (sum += n) >= half) + 1;
    cut = Math.min(Math.max(cut, 1), box.length - 1);
    boxes = [box.slice(0, cut), box.slice(cut), ...boxes.slice(1)];
  }
  for (const box of boxes) {
    const total = box.reduce((sum, { n }) => sum + n, 0);
    palette.push([0, 1, 2].map((k) => Math.round(box.reduce((sum, { rgb, n }) => sum + rgb[k] * n, 0) / total)));
  }
  return palette;
}

/** The check sum of a PNG chunk. */
function checksum(bytes) {
  let sum = ~0;
  for (const byte of bytes) {
    sum ^= byte;
    for (let i = 0; i < 8; ++i) sum = (sum >>> 1) ^ (sum & 1 ? 0xedb88320 : 0);
  }
  return ~sum >>> 0;
}

/** A PNG with a palette. */
function encode({ width, height, pixels }, palette) {
  const nearest = new Map();
  const find = (key) => {
    if (!nearest.has(key)) {
      const rgb = [key >> 16, (key >> 8) & 255, key & 255];
      const distances = palette.map((c) => (c[0] - rgb[0]) ** 2 + (c[1] - rgb[1]) ** 2 + (c[2] - rgb[2]) ** 2);
      nearest.set(key, distances.indexOf(Math.min(...distances)));
    }
    return nearest.get(key);
  };
  const rows = Buffer.alloc((width + 1) * height);
  for (let y = 0; y < height; ++y)
    for (let x = 0; x < width; ++x) rows[y * (width + 1) + 1 + x] = find(pixels.readUIntBE(4 * (y * width + x), 3));
  const chunk = (type, data) => {
    const body = Buffer.concat([Buffer.from(type), data]);
    const frame = Buffer.alloc(8);
    frame.writeUInt32BE(data.length, 0);
    frame.writeUInt32BE(checksum(body), 4);
    return Buffer.concat([frame.subarray(0, 4), body, frame.subarray(4)]);
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(width, 0);
  head.writeUInt32BE(height, 4);
  head.set([8, 3, 0, 0, 0], 8); // 8 bits, palette
  return Buffer.concat([
    Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]),
    chunk('IHDR', head),
    chunk('PLTE', Buffer.from(palette.flat())),
    chunk('IDAT', deflateSync(rows, { level: 9, memLevel: 9 })),
    chunk('IEND', Buffer.alloc(0)),
  ]);
}

const take = options.verification ? takeVerification : options.sweep !== undefined ? takeSweep : options.replay !== undefined ? takeReplay : takeFigure;
const picture = await decode(await take());
const png = encode(picture, makePalette(picture.pixels, Number(options.colours ?? (take === takeFigure ? 64 : 160))));
await writeFile(target, png);
console.log(`${target}: ${picture.width} x ${picture.height}, ${(png.length / 1024).toFixed(0)} KB`);
await browser.close();
