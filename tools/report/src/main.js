import { DataError } from './blocks.js';
import { fillToolbar, fillTransport } from './controls.js';
import { loadRun } from './data.js';
import { part, startPage } from './dom.js';
import { figureText } from './exporting.js';
import { createHelp, listenToKeys } from './keyboard.js';
import { createPlayer } from './player.js';
import { PlotArea } from './plots.js';
import { HIDDEN_AT_FIRST } from './quantities.js';
import { createReplay } from './replay.js';
import { State } from './state.js';
import { fillDetails, fillHead, fillSummary, JointTable } from './table.js';
import { initTheme } from './theme.js';
import { Verification } from './verification.js';

const explain = (error) =>
  error instanceof DataError ? `This report cannot be shown. ${error.message}` : `A part of this report cannot be shown: ${error?.message ?? error}`;

async function start() {
  let state = null;
  initTheme(() => state?.emit('theme'));
  const run = await loadRun();
  document.title = run.title ? `${run.title} – viable` : 'viable report';
  state = new State(run);
  for (const key of HIDDEN_AT_FIRST) state.hiddenKinds.add(key);

  const openHelp = createHelp(part('help'));
  fillHead(part('head'), run);
  fillSummary(part('summary'), run);
  fillToolbar(part('toolbar'), state, { openHelp });
  fillTransport(part('transport'), state);
  fillDetails(part('details'), run);
  createPlayer(state);
  listenToKeys(state, openHelp);
  part('loading').hidden = true;
  part('page').hidden = false;
  new Verification(part('verification'), state);
  new PlotArea(part('plots'), state);
  new JointTable(part('joints'), state);
  const replay = createReplay(part('replay'), run, state);
  window.viableReport = { state, replay, figure: (options) => figureText(state, options) }; // for scripts
}

startPage(start, explain);
