import { button, el, swatch } from '../dom.js';
import { isOk, prettyStatus } from './data.js';
import { copyButton } from './table.js';

/** The run that the reader has chosen: its status, what it drew, its results, and the command that runs it again. */
export function createSelected(host, state) {
  const { sweep } = state;
  const show = () => {
    const row = state.selected;
    host.hidden = row === null;
    if (row === null) return;
    const c = sweep.cases[sweep.caseOf[row]];
    const status = sweep.statuses[row];
    const replay = sweep.value('replay', row);
    const message = sweep.value('message', row);
    const list = (columns) =>
      el(
        'dl',
        ...columns
          .filter((column) => column.has(row))
          .flatMap((column) => [el('dt', { text: column.label, title: column.name }), el('dd', { text: column.show(row, true) })]),
      );
    host.replaceChildren(
      el(
        'div.section-head',
        swatch(c.index),
        el('h2', { text: `Run ${sweep.run[row]} · ${c.name}` }),
        el('span', { class: isOk(status) ? 'status-ok' : 'status-bad', text: prettyStatus(status) }),
        state.result ? el('span', { text: `${state.result.label} ${state.result.show(row, true)}` }) : null,
        el('span.push'),
        replay ? copyButton(replay) : null,
        button({ class: 'icon-button', text: '×', 'aria-label': 'Close', title: 'Close (Escape)', onclick: () => state.select(row) }),
      ),
      message ? el('p.run-message', { text: message }) : '',
      replay ? el('code.replay-command', { tabindex: 0, text: replay }) : '',
      el(
        'details',
        el('summary', { text: 'All values' }),
        el('div.values', list(sweep.draws), list(sweep.columns.filter(({ kind }) => kind === 'result'))),
      ),
    );
  };
  state.on('select result', show);
  addEventListener('keydown', ({ key }) => key === 'Escape' && state.selected !== null && state.select(state.selected));
}
