import { unpackBlocks } from '../blocks.js';
import { el } from '../dom.js';
import { Emitter } from '../emitter.js';
import { initTheme } from '../theme.js';
import { Hand } from './hand.js';
import { Link } from './link.js';
import { Bar, HandPanel, JointPanel, TimePanel, viewHead } from './panel.js';
import { phonePad } from './phone.js';
import { Placed } from './placed.js';
import { Strips } from './strips.js';
import { View } from './view.js';
import { Headset } from './xr.js';

const SILENT_MS = 1500;
const SILENT = 'Nothing comes from the arm. What is seen here is old, and Stop may not arrive: use the arm\u2019s own stop.';

const part = (id) => document.getElementById(id);
const page = new Emitter();

function showMessage(text) {
  part('message').textContent = text;
  part('message').hidden = text === '';
}

/** What the program says of its case, as the parts of the page want it. */
async function readRun(live) {
  const { json, array } = await unpackBlocks(live);
  return {
    title: json.title,
    case: json.case,
    robot: json.robot.name,
    scene: json.scene,
    joints: json.robot.joints.map(({ name, kind }) => ({ name, linear: kind === 'prismatic' })),
    environment: json.environments[0] ?? null,
    links: json.links,
    obstacles: json.obstacles,
    moves: json.moves,
    places: json.places,
    hasReal: json.has_real,
    tick_s: json.tick_s,
    tMin: 0,
    array,
  };
}

/** A view, or why there is none: all else works without it. */
function createView(stage, run, hand) {
  const context = document.createElement('canvas').getContext('webgl2');
  const reason = !run.scene?.links?.length
    ? 'There is no description of the robot to show.'
    : !context
      ? 'The picture of the arm needs WebGL 2, which this browser does not offer. All else works without it.'
      : '';
  const name = context?.getParameter(context.getExtension('WEBGL_debug_renderer_info')?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
  context?.getExtension('WEBGL_lose_context')?.loseContext();
  if (!reason) return new View(stage, run, hand, /swiftshader|llvmpipe|software/i.test(String(name)));
  stage.append(el('p', { class: 'no-replay', role: 'status', text: reason }));
  return null;
}

async function begin(link) {
  const run = await readRun(link.live);
  if (run.title) document.title = `${run.title} – viable live`;
  const hand = new Hand(link, run.moves === 'joints' ? run.joints.length : 0);
  const stage = el('div', { class: 'stage' });
  const view = createView(stage, run, hand);
  const bar = new Bar(part('bar'), link, run, page);
  const headset = view && new Headset(view, hand, link);
  if (view) part('view').append(viewHead(view, run, headset));
  part('view').append(stage);
  let panels = null;
  // A line that fails without a word leaves the last picture standing: frames come all the while, also of an arm that is held.
  let heard = performance.now();
  let isSilent = false;
  link.on('frame open', () => {
    heard = performance.now();
  });
  setInterval(() => {
    const wasSilent = isSilent;
    isSilent = link.isOpen && panels !== null && performance.now() - heard > SILENT_MS;
    if (isSilent && part('message').hidden) showMessage(SILENT);
    if (isSilent === wasSilent || !link.isOpen) return;
    part('page').classList.toggle('lost', isSilent);
    if (isSilent) {
      showMessage(SILENT);
      headset?.say(SILENT);
    } else if (part('message').textContent === SILENT) {
      showMessage('');
    }
  }, SILENT_MS / 6);
  const update = () => {
    const isAllowed = Boolean(run.moves) && link.isOperator && bar.state === 'running';
    hand.allow(isAllowed);
    view?.allowDrag(isAllowed && run.moves === 'tool');
  };
  link.on('frame', () => {
    const { frame } = link;
    if (!panels) {
      run.joints.forEach((joint, i) => {
        const within = (value, fallback) => (Number.isFinite(value) ? value : fallback);
        joint.lower = within(frame('position_lower')[i], -Math.PI);
        joint.upper = within(frame('position_upper')[i], Math.PI);
      });
      panels = {
        hand: new HandPanel(part('operate'), stage, run, hand, view ?? { setMode() {} }, link, phonePad(view, hand)),
        joints: new JointPanel(part('joints'), run),
        times: new TimePanel(part('times'), run),
        strips: new Strips(part('strips'), run),
        placed: run.places && view ? new Placed(part('placed'), run, link, view) : null,
      };
      part('loading').hidden = true;
      part('page').hidden = false;
    }
    bar.show(frame);
    update();
    view?.show(frame);
    panels.hand.show(frame, bar.state);
    headset?.say(panels.hand.text);
    panels.strips.rests = Boolean(view?.isWorn);
    panels.strips.add(frame);
    if (view?.isWorn) return;
    panels.joints.show(frame);
    panels.times.show(frame);
    panels.placed?.show(frame);
  });
  link.on('people close', update);
  link.on('open close', () => {
    part('page').classList.toggle('lost', !link.isOpen);
    if (!link.isOpen && /^stop/.test(bar.state)) showMessage('The arm has been stopped, and the program has ended. What is seen here is how it was last.');
  });
  page.on('theme', () => {
    view?.paint();
    panels?.strips.paint();
  });
  window.viableLive = { link, hand, view }; // for scripts
}

function start() {
  initTheme(() => page.emit('theme'));
  const link = new Link();
  link.on('live', () => begin(link).catch(explain));
  link.on('open', () => showMessage(''));
  link.on('close', () => {
    part('loading').hidden = true;
    showMessage(link.reason);
  });
  link.open();
}

const explain = (error) => showMessage(`A part of this page does not work: ${error?.message ?? error}`);
addEventListener('error', (event) => explain(event.error ?? event.message));
addEventListener('unhandledrejection', (event) => explain(event.reason));
start();
