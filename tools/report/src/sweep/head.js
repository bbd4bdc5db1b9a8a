import { button, caseToggles, el, setPressed, tellHeight, titles, verdictItem, verdicts } from '../dom.js';
import { moment } from '../format.js';
import { themeButton } from '../theme_button.js';
import { isOk, OUTSIDE, prettyStatus, severity } from './data.js';
import { quantile } from './statistics.js';

/** A count with separators of thousands. */
export const count = (n) => (n + 0).toLocaleString('en-US'); // + 0: no negative zero

const plural = (n, word) => `${count(n)} ${word}${n === 1 ? '' : 's'}`;

/** How many rows have which status, the worst first. */
function countStatuses(sweep, rows) {
  const counts = new Map();
  for (const row of rows) counts.set(sweep.statuses[row], (counts.get(sweep.statuses[row]) ?? 0) + 1);
  return [...counts].sort(([a], [b]) => severity(a) - severity(b) || a.localeCompare(b));
}

/** Title, origin, and a verdict per case. */
export function fillHead(host, sweep) {
  const origin = [
    plural(sweep.cases.length, 'case'),
    `${count(sweep.done)} of ${plural(sweep.planned, 'run')}`,
    `seed ${sweep.seed}`,
    sweep.file,
    moment(sweep.created),
    sweep.writer && `viable ${sweep.writer}`,
  ];
  host.append(
    titles(sweep.title || 'Sweep', origin),
    sweep.isPartial ? el('p.partial.card', { role: 'status', text: partialText(sweep) }) : '',
    verdicts(Math.min(5, sweep.cases.length), sweep.cases.map((c) => verdict(sweep, c))),
  );
}

function partialText({ rows, planned, cases }) {
  const all = planned * cases.length;
  const what = cases.length > 1 ? ` (${plural(planned, 'run')} of ${plural(cases.length, 'case')})` : '';
  return (
    `Partial: ${count(rows)} of ${plural(all, 'result')}${what} are in the store. ` +
    'The sweep goes on or was stopped; "viable report" writes this page again.'
  );
}

function verdict(sweep, c) {
  const rows = [];
  for (let row = 0; row < sweep.rows; ++row) if (sweep.caseOf[row] === c.index) rows.push(row);
  const statuses = countStatuses(sweep, rows);
  const worst = Math.min(...statuses.map(([status]) => severity(status)), severity('ok'));
  const sentences = limitSentences(sweep, rows);
  const isKept = sentences.every(({ isGood }) => isGood);
  const kind = rows.length === 0 ? 'warn' : worst === severity('ok') ? (isKept ? 'ok' : 'warn') : worst < 2 ? 'bad' : 'warn';
  const text = rows.length === 0 ? 'no run is done yet' : sentences.map(({ text: one }) => one).join('; ');
  const parts = statuses.map(([status, n]) => `${count(n)} ${prettyStatus(status)}`).join(' · ');
  return verdictItem(kind, c, el('span', { text }), el('div.verdict-parts', { text: parts }));
}

/** In how many runs every limit was kept, by the nominal and the real arm, and how much of the bound was used. */
function limitSentences(sweep, rows) {
  const all = count(rows.length);
  const sentences = [];
  const uses = sweep.results.filter(({ name }) => /(^|\.)worst_use\./.test(name));
  for (const isReal of [false, true]) {
    const own = uses.filter(({ name }) => name.startsWith('real.') === isReal);
    if (!own.some((column) => rows.some((row) => column.has(row)))) continue;
    const kept = rows.filter((row) => {
      const known = own.filter((column) => column.has(row));
      return known.length > 0 && known.every(({ numbers }) => numbers[row] <= OUTSIDE);
    }).length;
    const text = isReal ? `the real joints kept theirs in ${count(kept)}` : `${count(kept)} of ${all} kept every limit`;
    sentences.push({ text: isReal && sentences.length === 0 ? `${text} of ${all}` : text, isGood: kept === rows.length });
  }
  for (const name of ['real.tool_error.rms_m', 'tool_error.rms_m', 'real.command_error.rms_rad', 'command_error.rms_rad']) {
    const column = sweep.results.find((one) => one.name === name);
    const errors = rows.filter((row) => column?.has(row)).map((row) => column.numbers[row]).sort((a, b) => a - b);
    if (errors.length === 0) continue;
    const [median, largest] = [quantile(errors, 0.5), errors.at(-1)].map((error) => column.format(error, true));
    sentences.unshift({ text: `${name.startsWith('real') ? 'the real arm' : 'it'} was ${median} from its command (median, RMS of a run), at most ${largest}`, isGood: true });
    break;
  }
  const share = sweep.results.find(({ name }) => name === 'bound.share');
  const most = rows.reduce((worst, row) => (share?.has(row) ? Math.max(worst, share.numbers[row]) : worst), -Infinity);
  if (most > -Infinity)
    sentences.push({ text: `the real arm used at most ${share.format(most)} of its tracking bound`, isGood: most <= OUTSIDE });
  const fine = rows.filter((row) => isOk(sweep.statuses[row])).length;
  if (sentences.length === 0) sentences.push({ text: `${count(fine)} of ${all} ended well`, isGood: fine === rows.length });
  return sentences;
}

/** The bar above the plots: which cases and statuses are shown, and which result. */
export function fillToolbar(host, state) {
  const { sweep } = state;
  host.append(
    caseToggles(state, sweep.cases, 'rows', () => state.shownCases),
    resultChoice(state),
    statusChips(state),
    el('span.push'),
    el('span.buttons', themeButton(state)),
  );
  if (sweep.rows === 0) host.querySelector('select')?.setAttribute('disabled', '');
  tellHeight(host);
}

/** The results, those of one thing (worst_use, tracking, ...) together. */
function resultChoice(state) {
  const groups = new Map();
  for (const column of state.sweep.results) {
    const parts = column.name.split('.');
    const group = parts.length > 1 ? parts.slice(0, parts[0] === 'real' ? 2 : 1).join(' ') : 'others';
    groups.set(group, [...(groups.get(group) ?? []), column]);
  }
  const select = el(
    'select',
    { 'aria-label': 'Result', onchange: () => state.set('result', { result: state.sweep.column(select.value) }) },
    ...[...groups].map(([label, columns]) =>
      el(
        'optgroup',
        { label: label.replaceAll('_', ' ') },
        ...columns.map(({ name, title }) => el('option', { value: name, text: title, title: name })),
      ),
    ),
  );
  if (state.result) select.value = state.result.name;
  return el('label.joint-choice', 'Result ', select);
}

function statusChips(state) {
  const { sweep } = state;
  const chips = countStatuses(sweep, sweep.statuses.keys()).map(([status, n]) => {
    const chip = button({
      class: `chip ${isOk(status) ? 'ok' : 'failing'}`,
      text: `${prettyStatus(status)} ${count(n)}`,
      title: `Show or hide the runs that are ${prettyStatus(status)}`,
      onclick: () => state.toggle('rows', state.hiddenStatuses, status),
    });
    state.follow('rows', () => setPressed(chip, !state.hiddenStatuses.has(status)));
    return chip;
  });
  return el('div.chips', { role: 'group', 'aria-label': 'Status' }, ...chips);
}
