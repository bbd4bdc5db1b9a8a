import { button, el, swatch, table, titles, verdictItem, verdicts } from './dom.js';
import { fixed, inNewtons, moment, number, seconds } from './format.js';
import { JUDGED, limitsIn } from './data.js';
import { ALL_CASES } from './state.js';

/** Title, origin and verdicts of the run. */
export function fillHead(host, run) {
  host.append(
    titles(run.title || 'Run', [run.robot, run.file, moment(run.created), `viable ${run.version}`]),
    verdicts(columnsFor(run.cases.length), run.cases.map(verdict)),
  );
}

/** At most five beside each other, in rows as equal as can be. */
const columnsFor = (count) => Math.ceil(count / Math.ceil(count / 5));

/** Units as people write them. */
export const pretty = (text) => text.replaceAll('/s^2', '/s²').replaceAll('/s^3', '/s³');

/** What stopped a case. The message may tell the time itself. */
function stopText({ time_s: time, message }) {
  return /^stopped at/.test(message) ? message : `stopped at ${number(time, 5)} s: ${message}`;
}

function verdict(c) {
  const kind = { good: 'ok', doubtful: 'warn' }[c.grade] ?? 'bad';
  const guarantee = c.guarantees ? 'guarantees its limits' : 'guarantees nothing';
  const [worst, ...others] = pretty(c.sentence || c.verdict).split('; ');
  const parts = [c.filter, c.robust_loop, c.plant].filter(Boolean).join(' · ');
  const rest = others.length > 0 ? el('span.verdict-rest', { text: ['', ...others].join('; ') }) : null;
  return verdictItem(
    kind,
    c,
    el('span', { title: `The filter ${guarantee}.` }, worst, rest),
    el(
      'details',
      el('summary.verdict-parts', { text: parts, title: `filter · robust loop · plant: ${parts}` }),
      c.sentence ? el('p.verdict-full', { text: pretty(c.verdict) }) : null,
      c.contact ? el('div.verdict-contact', { text: contactText(c.contact) }) : null,
      c.stop ? el('div.verdict-stop', { text: stopText(c.stop) }) : null,
    ),
  );
}

/** How hard the real arm pressed, and presses at the end. */
const contactText = ({ peak, time, obstacle, last }) =>
  peak > 0
    ? `pressed ${obstacle} with up to ${inNewtons(peak)} (at ${seconds(time)} s), ${inNewtons(last)} at the end`
    : 'the real arm touched nothing';

/** The table that the program prints, too. */
export function fillSummary(host, run) {
  const { columns = [], rows = [], note = '' } = run.summary;
  if (rows.length === 0) return;
  const isNumber = columns.map((_, i) => rows.every((row) => NUMBER.test(row[i] ?? '')));
  const told = columns.map((_, i) => i).filter((i) => i === 0 || !isNeedless(rows, i));
  const heads = told.map((i) => {
    const name = columns[i];
    return el('th', { scope: 'col', class: isNumber[i] ? 'number' : null, text: name, title: MEANINGS[name] ?? null });
  });
  const body = rows.map((row) =>
    el('tr', ...told.map((i) => cell(run, columns[i], row[i] ?? '', i, isNumber[i]))),
  );
  host.append(
    el(
      'div.scroll.card',
      { tabindex: 0, role: 'region', 'aria-label': 'Summary table' },
      table({ class: 'summary' }, heads, body),
    ),
    note ? el('p.hint', { text: note }) : null,
  );
}

const NUMBER = /^\s*([-–—]|inf|no limit|[-–−+]?[\d.,]+(e[-+]?\d+)?(\s*(%|[a-zµ°]+))?(, [\d.]+°)?)?\s*$/i;
const worstUse = (name) => [name, `Worst use of the ${name} limits by the nominal arm; beyond 100 % a limit is broken`];
const MEANINGS = {
  ...Object.fromEntries(JUDGED.map(worstUse)),
  outside: 'Ticks beyond any limit, counted per joint',
  infeasible: 'Ticks without an admissible choice',
  changed: 'Share of ticks that the filter changed',
  'command error': 'RMS distance of the nominal tool, or of the joints, from the commanded ones within the limits',
  'command error, real': 'The same of the real arm, as it truly was',
  chatter: 'RMS jerk of joints pressed against a position limit at rest, in percent of the jerk limit',
  collisions: 'Ticks in which the nominal arm touches an obstacle or itself',
  'collisions, real': 'Ticks in which the real arm, as it truly was, touches an obstacle or itself',
  'least clearance': 'Of the nominal arm in the whole run, from obstacles and from itself; negative: that deep inside',
  touched: 'What the real arm pressed hardest',
  'largest force': 'With which the real arm pressed on anything',
  'force at the end': 'With which the real arm presses in the last tick',
  'least clearance, real': 'Of the real arm, as it truly was, from obstacles and from itself; negative: that deep inside',
};

/** True if a column tells nothing: there is no value in it, or it is the first one again. */
function isNeedless(rows, column) {
  return rows.every((row) => /^\s*[-–—]?\s*$/.test(row[column] ?? '')) || rows.every((row) => row[column] === row[0]);
}

/** Whether a value of the table is bad news: a limit used beyond 100 %, ticks outside, without a choice, in collision. */
function isBad(column, text) {
  const value = parseFloat(text);
  if (/^(position|velocity|acceleration|jerk)$/.test(column)) return value > 100 || text === 'inf';
  if (/^least clearance/.test(column)) return value < 0;
  return /^(outside|infeasible|collisions|collisions, real)$/.test(column) && value > 0;
}

/** 499800 % instead of 4.998e+05 %. */
const plain = (text) => text.replace(/^\d\.?\d*e\+0[4-9](?= |$)/, (value) => String(Number(value)));

/** A text that may break behind _ and commas, where the table would be too wide. */
const breakable = (text) => text.split(/(?<=_|, )/).flatMap((part) => [el('wbr'), part]);

function cell(run, name, text, column, isNumber) {
  if (column > 0) {
    const classes = [isNumber ? 'number' : '', isBad(name, text) ? 'bad' : ''].filter(Boolean).join(' ');
    return el('td', { class: classes || null, 'data-label': name, }, ...breakable(isNumber ? plain(text) : text));
  }
  const known = run.cases.find((c) => c.name === text);
  return el('th', { scope: 'row', title: text }, known ? swatch(known.index) : null, text);
}

/** The long texts: what was run, and each case in detail. */
export function fillDetails(host, run) {
  const fold = (title, text, before = null) =>
    el('details.card', el('summary', before, title), el('pre', { tabindex: 0, text }));
  host.append(
    ...run.cases.filter((c) => c.details).map((c) => fold(c.name, c.details, swatch(c.index))),
    run.yaml ? fold('Resolved experiment file', run.yaml) : '',
    el('p.hint', { text: sampling(run) }),
  );
}

/** What a point of the plots stands for. */
function sampling(run) {
  const texts = run.cases.map((c) => {
    const ticks = Math.round(c.step / c.tick);
    return ticks > 1
      ? `the least and the largest value of ${ticks} ticks (${Number((c.step * 1000).toPrecision(4))} ms)`
      : 'every tick';
  });
  const same = texts.every((text) => text === texts[0]);
  return (
    `The plots show ${same ? texts[0] : run.cases.map((c, i) => `${texts[i]} of ${c.name}`).join(', ')}. ` +
    'The log of each case holds all ticks; `viable columns LOG` tells what its columns mean.'
  );
}

const HEADS = [
  ['Joint'],
  ['q', 'Nominal position [rad or m]'],
  ['range', 'Where it is between its position limits'],
  ['Δ [10⁻³]', 'Real minus nominal position [mrad or mm]'],
  ['acting limit'],
];

/** Per joint where it is between its limits, and what acts, for the case and the time of the replay. */
export class JointTable {
  constructor(host, state) {
    this.state = state;
    this.caption = el('h3');
    this.rows = state.run.joints.map((joint, j) => this.#row(joint, j));
    const heads = HEADS.map(([text, title]) => el('th', { scope: 'col', text, title }));
    host.append(this.caption, table({ class: 'joints' }, heads, this.rows.map(({ root }) => root)));
    state.on('time', () => this.#schedule());
    state.follow('replay joint', () => this.update());
  }

  #row(joint, j) {
    const mark = el('span.gauge-mark');
    const [q, error] = [el('td.number'), el('td.number')];
    const acting = el('td.acting');
    const title = `Show the plots of ${joint.name}`;
    const name = button({ class: 'joint-name', text: joint.name, title, onclick: () => this.state.setJoint(j) });
    const gauge = el('td', el('span.gauge', mark));
    const root = el('tr', el('th', { scope: 'row' }, name), q, gauge, error, acting);
    return { root, mark, q, error, acting };
  }

  #schedule() {
    this.timer ??= setTimeout(() => this.update(), 60);
  }

  update() {
    clearTimeout(this.timer);
    this.timer = null;
    const { state } = this;
    const { run } = state;
    const c = run.cases[state.replayCase === ALL_CASES ? Math.max(0, state.shown.indexOf(true)) : state.replayCase];
    const time = Math.min(Math.max(state.time, c.t0), c.end - c.step / 2);
    this.caption.replaceChildren('Joints of ', swatch(c.index), c.name, ` at ${seconds(state.time)} s`);
    const middle = (samples) => {
      const range = c.at(samples, time);
      return range ? (range[0] + range[1]) / 2 : NaN;
    };
    this.rows.forEach((row, j) => {
      const q = middle(c.samples(j, 'nominal_q'));
      const lower = middle(c.samples(j, 'position_lower'));
      const upper = middle(c.samples(j, 'position_upper'));
      const part = (q - lower) / (upper - lower);
      row.q.textContent = fixed(q, 3);
      row.mark.hidden = !Number.isFinite(part);
      row.mark.style.setProperty('left', `${(100 * Math.min(Math.max(part, 0), 1)).toFixed(1)}%`);
      const error = middle(c.thousandths(j, 'error'));
      row.error.textContent = fixed(error, 2);
      const names = c.bucketAt(time) < 0 ? [] : limitsIn(c.active[j][c.bucketAt(time)]);
      row.acting.textContent = names.map((name) => name.replace('_', ' ')).join(', ');
      row.acting.style.setProperty('--key', names.length ? `var(--limit-${names[0].split('_')[0]})` : 'transparent');
      row.root.classList.toggle('selected', j === state.joint);
    });
  }
}
