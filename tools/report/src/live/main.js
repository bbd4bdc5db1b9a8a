import { unpackBlocks } from '../blocks.js';
import { el, part, tellHeight } from '../dom.js';
import { Emitter } from '../emitter.js';
import { initTheme } from '../theme.js';
import { Hand } from './hand.js';
import { limitsOf } from './limits.js';
import { Link } from './link.js';
import { Bar, HandPanel, JointPanel, TimePanel, viewHead } from './panel.js';
import { phonePad } from './phone.js';
import { Placed } from './placed.js';
import { Strips } from './strips.js';
import { View } from './view.js';
import { Headset } from './xr.js';

const SAY_MS = 250;
const SILENT = 'No data from the arm. The picture is old, and Stop may not get through: use the arm’s own stop.';
const NO_CONNECTION = 'No connection: use the arm’s own stop.';
const ENDED = 'The arm has been stopped, and the program has ended. What is seen here is how it was last.';
const FAILED = 'The program has ended after a fault. If the arm still moves, use its own stop. What is seen here is how it was last.';

const page = new Emitter();
const link = new Link();
let failure = ''; // of the page itself
let hadFault = false; // of the arm
let end = ''; // how the arm ended, as far as the program has told it

/** Says what is wrong with the line and with the page: all at one place, so that neither hides the other. */
function tellTrouble() {
  const line = link.isOpen ? (link.isSilent ? SILENT : '') : end || link.reason;
  const text = [line, failure].filter(Boolean).join('\n');
  const message = part('message');
  if (message.textContent !== text) message.textContent = text;
  message.hidden = text === '';
  part('page').classList.toggle('lost', !link.isOpen || link.isSilent);
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
    limits: json.limits,
    places: json.places,
    hasReal: json.has_real,
    hasContact: json.has_contact,
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
  stage.append(el('p.no-replay', { role: 'status', text: reason }));
  return null;
}

async function begin() {
  const run = await readRun(link.live);
  if (run.title) document.title = `${run.title} – viable live`;
  const hand = new Hand(link, run.moves === 'joints' ? run.joints.length : 0);
  const stage = el('div.stage');
  const view = createView(stage, run, hand);
  const bar = new Bar(part('bar'), link, run, page);
  tellHeight(part('bar'));
  const headset = view && new Headset(view, hand, link);
  if (view) part('view').append(viewHead(view, run, headset));
  part('view').append(stage);
  let panels = null;
  // Also to who puts the headset on while the line is lost.
  const sayInHeadset = () => headset?.say(!link.isOpen ? end || NO_CONNECTION : link.isSilent ? SILENT : (panels?.hand.text ?? ''));
  setInterval(sayInHeadset, SAY_MS);
  const update = () => {
    const isAllowed = Boolean(run.moves) && link.isOperator && bar.state === 'running' && !link.isSilent;
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
    if (bar.state === 'stopped') end = hadFault ? FAILED : ENDED;
    update();
    view?.show(frame);
    panels.hand.show(frame, bar.state);
    sayInHeadset();
    panels.strips.rests = Boolean(view?.isWorn);
    panels.strips.add(frame);
    if (view?.isWorn) return;
    panels.joints.show(frame);
    panels.times.show(frame);
    panels.placed?.show(frame);
  });
  link.on('people close silence', update);
  link.on('silence open close', () => {
    panels?.hand.tellLine();
    sayInHeadset();
  });
  page.on('theme', () => {
    view?.paint();
    panels?.strips.ask();
  });
  window.viableLive = { link, hand, view, headset, limits: () => limitsOf(link.frame, run) }; // for scripts
}

function start() {
  initTheme(() => page.emit('theme'));
  link.on('live', () => begin().catch(explain));
  link.on('open', () => (end = ''));
  link.on('event', () => (hadFault ||= link.event.asker === 'fault'));
  link.on('close', () => (part('loading').hidden = true));
  link.on('open close silence', tellTrouble);
  link.open();
}

function explain(error) {
  failure = `A part of this page does not work: ${error?.message ?? error}`;
  tellTrouble();
}
addEventListener('error', (event) => explain(event.error ?? event.message));
addEventListener('unhandledrejection', (event) => explain(event.reason));
start();
