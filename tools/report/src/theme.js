import { recall, remember } from './storage.js';

// All colours of the page. Those of cases (Okabe and Ito) and of limits (IBM) can be told apart by colour-blind readers;
// each is also told by its place or its name.
const LIGHT = {
  background: '#f5f6f8',
  surface: '#ffffff',
  sunken: '#eef0f3',
  text: '#1a222c',
  muted: '#596574',
  line: '#dce1e7',
  grid: '#e9ecf0',
  accent: '#0b62a8',
  ok: '#16734a',
  warn: '#8a5800',
  bad: '#b3261e',
  limit: '#55606c',
  obstacle: '#a58a63',
  force: '#7a2fd0',
  arm: '#c3cad2', // without a colour of its own
  speeds: ['#f2a900', '#c11b17'], // of a link, after that of rest
  forbidden: 0.055, // how strongly the place beyond a limit is tinted
  cases: ['#0072b2', '#d55e00', '#00966c', '#bb5a93', '#b47c00', '#41a1de', '#6a5d00', '#46515e'],
  limits: { position: '#5c86f7', velocity: '#f2a900', acceleration: '#f2600c', jerk: '#d0267c', torque: '#6b4fbb', clearance: '#0f8f7a', speed: '#8a6a4f', separation: '#c23b3b' },
  status: { 2: '#9aa4b0', 3: '#c9d0d8', 4: '#c11b17', 5: '#10161d' },
};
const DARK = {
  background: '#0f1318',
  surface: '#171c22',
  sunken: '#1e242c',
  text: '#e3e8ee',
  muted: '#98a4b1',
  line: '#2a323b',
  grid: '#232a32',
  accent: '#6cb6f2',
  ok: '#4cc38a',
  warn: '#e5b454',
  bad: '#ff8078',
  limit: '#98a3b0',
  obstacle: '#b39a72',
  force: '#c79bff',
  arm: '#b9c2cc',
  speeds: ['#ffb829', '#ff5c52'],
  forbidden: 0.1,
  cases: ['#4ba6e6', '#ff8746', '#2cc499', '#e39ac6', '#eeb02a', '#a2daff', '#e4dc6a', '#c2ccd7'],
  limits: { position: '#7b9dff', velocity: '#ffb829', acceleration: '#ff7429', jerk: '#f0559f', torque: '#a98bff', clearance: '#35c9ae', speed: '#c49a78', separation: '#ff7f7f' },
  status: { 2: '#77828f', 3: '#48525d', 4: '#ff5c52', 5: '#ffffff' },
};
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
  const { style } = document.documentElement;
  style.colorScheme = dark ? 'dark' : 'light';
  document.documentElement.dataset.theme = dark ? 'dark' : 'light';
  for (const [name, value] of Object.entries(colours))
    if (typeof value === 'string') style.setProperty(`--${name}`, value);
  colours.cases.forEach((colour, i) => style.setProperty(`--case-${i}`, colour));
  for (const [name, colour] of Object.entries(colours.limits)) style.setProperty(`--limit-${name}`, colour);
  for (const [code, colour] of Object.entries(colours.status)) style.setProperty(`--status-${code}`, colour);
  changed();
}
