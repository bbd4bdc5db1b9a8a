import { DataError } from '../blocks.js';
import { el, part, startPage } from '../dom.js';
import { initTheme } from '../theme.js';
import { isOk, loadSweep } from './data.js';
import { fillHead, fillToolbar } from './head.js';
import { DrawHistogram, ResultHistogram } from './histograms.js';
import { Influence } from './scatter.js';
import { createSelected } from './selected.js';
import { State } from './state.js';
import { RunTable } from './table.js';

const explain = (error) =>
  `${error instanceof DataError ? 'This report' : 'A part of this report'} cannot be shown. ${error?.message ?? error}`;

function fillDistribution(host, state) {
  const histogram = new ResultHistogram(state);
  host.append(histogram.root);
  state.on('rows result', () => histogram.update());
  state.on('theme', () => histogram.invalidate());
}

function fillTables(state) {
  const { sweep } = state;
  const named = (...names) => names.map((name) => sweep.column(name));
  const isFailing = (row) => !isOk(sweep.statuses[row]);
  part('failing').hidden = sweep.statuses.every(isOk);
  if (!part('failing').hidden)
    new RunTable(part('failing'), state, {
      name: 'failing runs',
      title: (n) => `Failing runs (${n.toLocaleString('en-US')})`,
      hint: 'every run that is not ok',
      admits: isFailing,
      columns: () => [...named('status', 'replay', 'message', 'exit_code'), state.result, ...sweep.draws],
      sort: { key: () => 'status', isDown: true },
    });
  new RunTable(part('worst'), state, {
    name: 'runs',
    title: () => (state.result ? `Runs by ${state.result.label}` : 'Runs'),
    hint: 'the worst first; a click on a head sorts',
    admits: () => true,
    columns: () => [...named('status'), state.result, ...named('replay'), ...sweep.draws, ...named('wall_s')],
    sort: { key: () => state.result?.name ?? 'run', isDown: true },
  });
}

/** What was drawn, every run once: the cases of a run share its draws. */
function fillDraws(host, state) {
  const { sweep } = state;
  host.hidden = sweep.draws.length === 0;
  const seen = new Set();
  const rows = [];
  sweep.run.forEach((run, row) => {
    if (!seen.has(run)) rows.push(row);
    seen.add(run);
  });
  const panels = sweep.draws.map((draw) => new DrawHistogram(sweep, draw, rows));
  host.append(
    el('div.section-head', el('h2', { text: 'What was drawn' }), el('span.hint', { text: 'how often which value, over all runs that are done' })),
    el('div.multiples', ...panels.map(({ root }) => root)),
  );
  state.on('theme', () => panels.forEach((panel) => panel.invalidate()));
}

function fillDetails(host, sweep) {
  if (sweep.experiment)
    host.append(
      el('details.card', el('summary', { text: 'Experiment file' }), el('pre', { tabindex: 0, text: sweep.experiment })),
    );
  const hash = sweep.file_hash ? ` The hash of the experiment file is ${sweep.file_hash}.` : '';
  const text =
    'Beyond the limit: more than 100 % by more than rounding. The store sweep.sqlite beside this page holds every ' +
    `value in full.${hash}`;
  host.append(el('p.hint', { text }));
}

async function start() {
  let state = null;
  initTheme(() => state?.emit('theme'));
  const sweep = await loadSweep();
  document.title = sweep.title ? `${sweep.title} – viable sweep` : 'viable sweep';
  state = new State(sweep);
  fillHead(part('head'), sweep);
  fillToolbar(part('toolbar'), state);
  part('loading').hidden = true;
  part('page').hidden = false;
  fillDistribution(part('distribution'), state);
  fillTables(state);
  new Influence(part('influence'), state);
  fillDraws(part('draws'), state);
  fillDetails(part('details'), sweep);
  createSelected(part('selected'), state);
  window.viableSweep = { state }; // for scripts
}

startPage(start, explain);
