import { button, caseToggles, choice, el, icon, iconButton, tellHeight } from './dom.js';
import { limitCharts, saveFigure } from './exporting.js';
import { seconds } from './format.js';
import { ALL_JOINTS } from './state.js';
import { themeButton } from './theme_button.js';

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];

/** The bar above the plots: which cases, which joint, what times. */
export function fillToolbar(host, state, { openHelp }) {
  host.append(
    caseToggles(state, state.run.cases, 'cases', () => state.shown, ...caseKeys(state)),
    jointChoice(state),
    zoomButtons(state),
    ...takeChoice(state),
    el('span.push'),
    figureButtons(state),
    el(
      'span.buttons',
      themeButton(state),
      button({ class: 'icon-button', 'aria-label': 'Keys', title: 'Keys (?)', text: '?', onclick: openHelp }),
    ),
  );
  tellHeight(host);
}

/** What the button of a case does besides, and its key. */
const caseKeys = (state) => [
  (c, i) => ({
    title: `Show or hide ${c.name}${i < 9 ? ` (${i + 1})` : ''}; double click: it alone`,
    ondblclick: () => state.toggleAlone(i),
    onpointerenter: (event) => state.setFocus(event.pointerType === 'mouse' ? i : null),
    onpointerleave: () => state.setFocus(null),
  }),
  (i) => (i < 9 ? el('kbd', { 'aria-hidden': 'true', text: i + 1 }) : null),
];

function jointChoice(state) {
  const { joints } = state.run;
  const options = joints.map(({ name }, j) => [j, name]);
  if (joints.length > 1) options.push([ALL_JOINTS, 'all joints']);
  const select = choice({ 'aria-label': 'Joint', title: 'Joint (j, k)' }, options, state.joint, (value) => state.setJoint(Number(value)));
  state.on('joint', () => (select.value = String(state.joint)));
  return el('label.joint-choice', 'Joint ', select);
}

function zoomButtons(state) {
  const text = el('span.view-text');
  const reset = iconButton('reset', 'Show the whole run (0, or double click in a plot)', () => state.resetView());
  state.follow('view', () => {
    text.textContent = `${seconds(state.view.min)} – ${seconds(state.view.max)} s`;
    reset.disabled = !state.isZoomed;
  });
  return el(
    'span.buttons',
    { role: 'group', 'aria-label': 'Time in view' },
    iconButton('minus', 'Show more time (−)', () => state.zoom(2)),
    iconButton('plus', 'Zoom in at the scrubber (+)', () => state.zoom(0.5)),
    reset,
    text,
  );
}

const TAKE_BUTTONS = 6;

/** What the operator of a live run recorded, to go there. */
function takeChoice(state) {
  const { cases } = state.run;
  const takes = cases.flatMap((c) => c.takes.map((take) => ({ ...take, of: cases.length > 1 ? ` of ${c.name}` : '' })));
  if (takes.length === 0) return [];
  const name = ({ number, of }) => `Take ${number}${of}`;
  const times = ({ from_s, to_s }) => `${seconds(from_s)} to ${seconds(to_s)} s`;
  const go = ({ from_s, to_s }) => {
    state.setView(from_s, to_s);
    state.setTime(from_s);
  };
  if (takes.length > TAKE_BUTTONS) {
    const forget = () => (select.value = ''); // the same one again is a choice, too
    const options = [['', 'Takes'], ...takes.map((take, i) => [i, `${name(take)}, ${times(take)}`])];
    const select = choice({ 'aria-label': 'Take', onpointerdown: forget, onblur: forget }, options, null, (value) => value !== '' && go(takes[Number(value)]));
    return [select];
  }
  const show = (take) => button({ text: name(take), title: `Show ${times(take)}`, onclick: () => go(take) });
  return [el('span.buttons', { role: 'group', 'aria-label': 'Takes' }, ...takes.map(show))];
}

function figureButtons(state) {
  const save = (format) => {
    const name = format.toUpperCase();
    const title = `Save position, velocity, acceleration and jerk in view, below each other, as ${name}`;
    const onclick = () => saveFigure(state, { charts: limitCharts(state, state.joint), view: state.view }, format);
    return button({ class: 'quiet', text: name, 'aria-label': `Figure as ${name}`, title, onclick });
  };
  return el('span.figure.tools', 'Figure', save('png'), save('svg'));
}

/** The bar at the foot of the page: play, scrubber, speed. */
export function fillTransport(host, state) {
  const { run } = state;
  const play = iconButton('play', 'Play', () => state.setPlaying(!state.playing));
  const scrubber = el('input', {
    type: 'range',
    id: 'scrubber',
    min: run.tMin,
    max: run.tMax,
    step: 'any',
    'aria-label': 'Time',
    oninput: () => state.setTime(Number(scrubber.value)),
  });
  const time = el('output.time', { for: 'scrubber' });
  const speeds = SPEEDS.map((value) => [value, `${value} ×`]);
  const speed = choice({ 'aria-label': 'Speed', title: 'Speed' }, speeds, state.speed, (value) => state.set('speed', { speed: Number(value) }));
  state.follow('time', () => {
    scrubber.value = String(state.time);
    scrubber.style.setProperty('--played', `${(100 * (state.time - run.tMin)) / (run.tMax - run.tMin)}%`);
    scrubber.setAttribute('aria-valuetext', `${seconds(state.time)} seconds`);
    time.textContent = `${seconds(state.time)} s`;
  });
  state.on('play', () => {
    play.replaceChildren(icon(state.playing ? 'pause' : 'play'));
    play.setAttribute('aria-label', state.playing ? 'Pause' : 'Play');
  });
  host.append(play, time, scrubber, speed);
}
