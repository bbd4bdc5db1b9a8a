import { recall, remember } from './storage.js';

// All colours of the page, in light and in dark. Those of cases (Okabe and Ito) and of limits (IBM) can be told apart by
// colour-blind readers; each is also told by its place or its name.
const COLOURS = {
  background: ['#f5f6f8', '#0f1318'],
  surface: ['#ffffff', '#171c22'],
  sunken: ['#eef0f3', '#1e242c'],
  text: ['#1a222c', '#e3e8ee'],
  muted: ['#596574', '#98a4b1'],
  line: ['#dce1e7', '#2a323b'],
  grid: ['#e9ecf0', '#232a32'],
  accent: ['#0b62a8', '#6cb6f2'],
  ok: ['#16734a', '#4cc38a'],
  warn: ['#8a5800', '#e5b454'],
  bad: ['#b3261e', '#ff8078'],
  limit: ['#55606c', '#98a3b0'],
  obstacle: ['#a58a63', '#b39a72'],
  force: ['#7a2fd0', '#c79bff'],
  arm: ['#c3cad2', '#b9c2cc'], // without a colour of its own
  speeds: [['#f2a900', '#c11b17'], ['#ffb829', '#ff5c52']], // of a link, after that of rest
  forbidden: [0.055, 0.1], // how strongly the place beyond a limit is tinted
  cases: [
    ['#0072b2', '#d55e00', '#00966c', '#bb5a93', '#b47c00', '#41a1de', '#6a5d00', '#46515e'],
    ['#4ba6e6', '#ff8746', '#2cc499', '#e39ac6', '#eeb02a', '#a2daff', '#e4dc6a', '#c2ccd7'],
  ],
  limits: [
    { position: '#5c86f7', velocity: '#f2a900', acceleration: '#f2600c', jerk: '#d0267c', torque: '#6b4fbb', clearance: '#0f8f7a', speed: '#8a6a4f', separation: '#c23b3b' },
    { position: '#7b9dff', velocity: '#ffb829', acceleration: '#ff7429', jerk: '#f0559f', torque: '#a98bff', clearance: '#35c9ae', speed: '#c49a78', separation: '#ff7f7f' },
  ],
  status: [
    { 2: '#9aa4b0', 3: '#c9d0d8', 4: '#c11b17', 5: '#10161d' },
    { 2: '#77828f', 3: '#48525d', 4: '#ff5c52', 5: '#ffffff' },
  ],
};
const [LIGHT, DARK] = [0, 1].map((i) => Object.fromEntries(Object.entries(COLOURS).map(([name, both]) => [name, both[i]])));
const STORE = 'viable-theme';

/** The colours in use. */
export let colours = LIGHT;
/** Those of figures for documents, whatever the page shows. */
export const printColours = LIGHT;

export const caseColour = (index, palette = colours) => palette.cases[index % palette.cases.length];

/** Beyond the eighth case colours come again, the lines broken. */
const DASHES = [[], [9, 4], [2, 3], [12, 3, 2, 3]];
export const caseDash = (index) => DASHES[Math.floor(index / LIGHT.cases.length) % DASHES.length];

/** The colour of an acting limit, by its name. */
export const limitColour = (name, palette = colours) => palette.limits[name.split('_')[0]] ?? palette.limit;

export const isDark = () => colours === DARK;

let changed = () => {};

/** Follows the reader's choice, else that of the system; `onChange` hears when the colours are others. */
export function initTheme(onChange) {
  changed = onChange;
  const system = matchMedia('(prefers-color-scheme: dark)');
  system.addEventListener('change', () => {
    if (!stored()) apply(system.matches);
  });
  apply((stored() ?? (system.matches ? 'dark' : 'light')) === 'dark');
}

export function toggleTheme() {
  remember('localStorage', STORE, isDark() ? 'light' : 'dark');
  apply(!isDark());
}

const stored = () => recall('localStorage', STORE);

function apply(dark) {
  colours = dark ? DARK : LIGHT;
  const { style, dataset } = document.documentElement;
  style.colorScheme = dataset.theme = dark ? 'dark' : 'light';
  for (const [name, value] of Object.entries(colours))
    if (typeof value === 'string') style.setProperty(`--${name}`, value);
  colours.cases.forEach((colour, i) => style.setProperty(`--case-${i}`, colour));
  for (const [name, colour] of Object.entries(colours.limits)) style.setProperty(`--limit-${name}`, colour);
  for (const [code, colour] of Object.entries(colours.status)) style.setProperty(`--status-${code}`, colour);
  changed();
}
