import { button, choice, el, freeKeys, iconButton, setPressed, swatch, table } from '../dom.js';
import { fixed, inNewtons, number } from '../format.js';
import { limitColour } from '../theme.js';
import { themeButton } from '../theme_button.js';
import { limitsOf } from './limits.js';

const STATES = ['armed', 'running', 'stopping', 'stopped'];
const STATE_TEXTS = {
  armed: 'Armed: held where it is',
  running: 'Running',
  stopping: 'Stopping for good',
  stopped: 'Stopped: the robot holds itself',
};
/** Who held or stopped it. */
const ASKERS = {
  key: 'by a key in the terminal',
  page: 'from a page',
  signal: 'by a signal',
  duration: 'its time was over',
  fault: 'by a fault',
};
const HANDS = ['Ready.', 'Moving', 'Held: no fresh message.', 'Refused'];
const REFUSALS = [
  '',
  'a value was not a number',
  'the hand was lost, the page was not seen, or the connection is more than 0.5 s late',
  'the hand jumped',
  'nothing fresh for half a second: the connection is too slow, or broke',
  'the arm was held meanwhile',
];
const NOT_FOLLOWED = 'The arm does not follow: the connection is more than 0.2 s late.';
const NAMED_MS = 500; // a limit that acted is named for so long: the note looks at one tick of each PERIOD_MS
const PATIENCE_MS = 500; // from a press until it is told that the arm does not follow
const PERIOD_MS = 100;

const nameOf = (limit) => limit.replace('_', ' ').replace('clearance lower', 'clearance');

/** The head: what is run, its state, and what can be asked of it. */
export class Bar {
  #state = '';
  #recorded = 0; // the number of the take; 0: none
  #invitation = null; // the dialog

  constructor(host, link, run, page) {
    this.link = link;
    this.pill = el('span.pill', { role: 'status' });
    this.asker = el('span.hint.asker');
    this.people = el('span.hint.people');
    const act = (text, title, word, properties = {}) => button({ text, title, onclick: () => link.say(word), ...properties });
    this.take = act('Take control', 'Only one page moves the arm', 'take', {
      onclick: () => link.say(link.isOperator ? 'leave' : link.people.operator === null ? 'take' : 'take over'),
    });
    this.start = act('Start', 'The command begins, or goes on', 'start', { class: 'go' });
    this.pause = act('Hold', 'Brakes and holds the arm (space)', 'pause', { class: 'hold' });
    this.stop = act('Stop', 'Brakes and ends', 'stop', { class: 'halt' });
    this.record = act('Record', 'Marks what happens as a take, to find and to export it later, until it is pressed again', 'record', {
      class: 'record',
      onclick: () => link.say(this.#recorded > 0 ? 'end record' : 'record'),
    });
    this.recorded = el('span.hint.recorded', { role: 'status' });
    this.invite = act('Invite', 'An address for one more browser', 'invite');
    host.append(
      el(
        'div.title',
        el('h1', { text: run.title || 'A live arm' }),
        el('p.origin', { text: [run.robot, run.case].filter(Boolean).join(' · ') }),
      ),
      this.people,
      this.asker,
      this.recorded,
      el('span.push'),
      el('span.buttons.acts', run.moves ? this.take : null, this.start, this.pause, this.stop, this.record, this.pill),
      el('span.buttons', this.invite, themeButton(page)),
    );
    link.on('people open close silence event', () => this.#update());
    link.on('invitation', () => link.say('watch'));
    link.on('watch', () => this.#showInvitation());
    this.run = run;
    // By itself only a dialog that locks the page closes.
    addEventListener('keydown', ({ key }) => key === 'Escape' && this.#invitation?.close());
    // Space brakes, whatever has the focus: nothing is written on this page, and a button in focus is not pressed.
    const brake = (event) => {
      if (event.key !== ' ') return;
      event.preventDefault();
      if (event.type === 'keydown' && !event.repeat) link.say('pause');
    };
    for (const kind of ['keydown', 'keyup']) addEventListener(kind, brake, { capture: true });
    this.#update();
  }

  get state() {
    return this.#state;
  }

  show(frame) {
    const state = STATES[frame('state')[0]] ?? '';
    const recorded = frame('take')[0];
    if (state === this.#state && recorded === this.#recorded) return;
    this.#state = state;
    this.#recorded = recorded;
    this.#update();
  }

  #update() {
    const { link } = this;
    const state = link.isOpen ? this.#state : 'lost';
    const text = STATE_TEXTS[state] ?? '';
    this.pill.className = `pill ${link.isSilent ? 'lost' : state}`;
    this.pill.textContent = state === 'lost' ? 'No connection' : link.isSilent ? `No data (last: ${text.split(':')[0]})` : text;
    const isOf = state === link.event?.event && state !== 'running';
    this.asker.textContent = isOf ? (ASKERS[link.event.asker] ?? '') : '';
    const { operator, people } = link.people;
    this.take.textContent = link.isOperator ? 'Let go of control' : operator === null ? 'Take control' : 'Take over';
    setPressed(this.take, link.isOperator);
    const isOver = state === 'stopping' || state === 'stopped' || state === 'lost';
    // What is pressed while the line is silent takes effect whenever it recovers: only what brakes may.
    this.take.disabled = isOver || link.isSilent;
    const mayOperate = !this.run.moves || link.isOperator;
    this.start.disabled = isOver || link.isSilent || state === 'running' || !mayOperate;
    const hasTicks = state !== 'stopped' && state !== 'lost';
    const isRecording = hasTicks && this.#recorded > 0;
    this.record.disabled = !hasTicks || link.isSilent || !mayOperate;
    setPressed(this.record, isRecording);
    this.recorded.textContent = isRecording ? `Recording take ${this.#recorded}` : '';
    this.pause.disabled = state !== 'running';
    this.stop.disabled = isOver;
    this.invite.disabled = state === 'lost';
    const whose = link.isOperator ? 'You operate' : operator === null ? 'Nobody operates' : 'Another page operates';
    this.people.textContent = [this.run.moves && !isOver ? whose : '', people > 1 && state !== 'lost' ? `${people} pages open` : ''].filter(Boolean).join(', ');
  }

  /** Beside Stop and not above it, and the page is not locked meanwhile. */
  #showInvitation() {
    this.#invitation?.remove();
    const field = el('input', { readonly: true, value: this.link.invitation, 'aria-label': 'Address' });
    const dialog = el(
      'dialog.invitation',
      { 'aria-label': 'An address for one more browser' },
      el('h2', { text: 'For one more browser' }),
      el('p.hint', { text: 'This address lets one browser in, once. Whoever is in may take control.' }),
      field,
      el('p.hint', { text: 'Foxglove and Lichtblick see the arm here, as “Foxglove WebSocket”, and cannot move it:' }),
      el('input', { readonly: true, value: this.link.watch, 'aria-label': 'Address for programs' }),
      el('form', { method: 'dialog' }, el('button', { text: 'Close' })),
    );
    dialog.addEventListener('close', () => dialog.remove());
    this.#invitation = dialog;
    document.body.append(dialog);
    dialog.show();
    field.select();
  }
}

/** How the hand moves the arm, and how it is just now. */
export class HandPanel {
  constructor(host, stage, run, hand, view, link, pad) {
    this.run = run;
    this.hand = hand;
    this.link = link;
    this.note = el('p.hand-note', { role: 'status' });
    host.append(el('div.card-head', el('h2', { text: run.moves === 'joints' ? 'Move the joints' : 'Move the tool' })));
    if (run.moves === 'tool') host.append(this.#toolControls(view));
    if (run.moves === 'tool' && pad) host.append(pad);
    if (run.moves === 'joints') host.append(this.#sliders());
    if (!run.moves) host.append(el('p.hint', { text: 'This case has a command of its own; this page shows what it does.' }));
    stage.append(this.note); // where the operator looks
    this.last = 0;
  }

  #toolControls(view) {
    const { hand } = this;
    const modes = ['translate', 'rotate'].map((mode) =>
      button({
        text: mode === 'translate' ? 'Shift' : 'Turn',
        title: mode === 'translate' ? 'Drag the arrows (key T)' : 'Drag the rings (key R)',
        'aria-pressed': String(mode === 'translate'),
        onclick: () => choose(mode),
      }),
    );
    const choose = (mode) => {
      view.setMode(mode);
      modes.forEach((one, i) => setPressed(one, (i === 1) === (mode === 'rotate')));
    };
    addEventListener('keydown', ({ key, target, ctrlKey, metaKey }) => {
      if (ctrlKey || metaKey || target.closest?.('input, select')) return;
      if (key === 't' || key === 'r') choose(key === 't' ? 'translate' : 'rotate');
    });
    const output = el('output', { text: '1.0 ×' });
    const scale = el('input', {
      type: 'range',
      min: '-1',
      max: String(Math.log10(5)),
      step: '0.01',
      value: '0',
      'aria-label': 'Metres of the tool per metre of the hand',
      oninput: () => {
        hand.scale = Math.min(5, Math.max(0.1, 10 ** Number(scale.value)));
        output.textContent = `${hand.scale.toFixed(1)} ×`;
      },
    });
    freeKeys(scale);
    const parts = ['position and turn', 'position only', 'turn only'].map((text, value) => [value, text]);
    const part = choice({ 'aria-label': 'What of the hand counts' }, parts, null, (value) => {
      hand.part = Number(value);
      if (!part.matches(':focus-visible')) part.blur();
    });
    return el(
      'div.controls',
      el('div.row', el('span.buttons.segmented', ...modes), part),
      el('label.row', el('span.hint', { text: 'Scale' }), scale, output),
      el(
        'p.hint.keys',
        'Drag the arrows at the tool; it moves while you hold. ',
        el(
          'span.desk',
          'Keys: ',
          ...['←', '→', '↑', '↓', 'PgUp', 'PgDn'].map((text) => el('kbd', { text })),
          ' shift, with ',
          el('kbd', { text: '⇧' }),
          ' they turn, ',
          el('kbd', { text: 'space' }),
          ' holds the arm. Gamepad: hold the right shoulder.',
        ),
      ),
    );
  }

  #sliders() {
    const { run, hand } = this;
    let goal = []; // of all joints: only that of the slider that is held changes
    const press = (by) => {
      if (!hand.isPressed && hand.press(by, { joints: this.#q })) goal = [...this.#q];
    };
    this.sliders = run.joints.map(({ name, lower, upper }, i) => {
      const slider = el('input', { type: 'range', min: lower, max: upper, step: 'any', 'aria-label': name });
      const by = `slider ${i}`;
      slider.addEventListener('pointerdown', () => press(by));
      slider.addEventListener('input', () => {
        if (!hand.isPressedBy(by)) return;
        goal[i] = Number(slider.value);
        hand.move(by, { joints: goal });
      });
      for (const event of ['pointerup', 'pointercancel', 'lostpointercapture', 'keyup', 'blur'])
        slider.addEventListener(event, () => hand.release(by));
      slider.addEventListener('keydown', ({ key, repeat }) => {
        if (!repeat && /^(Arrow|Page)/.test(key)) press(by);
      });
      return slider;
    });
    return el(
      'div.controls',
      ...this.sliders.map((slider, i) => el('label.row', el('span.hint', { text: run.joints[i].name }), slider)),
      el(
        'p.hint',
        'A joint moves to where its slider is, while that is held. ',
        el('span.desk', el('kbd', { text: 'space' }), ' holds the arm.'),
      ),
    );
  }

  #q = [];
  #acted = new Map(); // a limit: when it acted last [ms]

  get text() {
    return this.note.textContent;
  }

  /** Each where its joint is, between the limits of now; those of a joint without limits are half a turn away. */
  #placeSliders(frame) {
    const ends = ['position_lower', 'position_upper'].map(frame);
    this.sliders.forEach((slider, i) => {
      const [lower, upper] = ends.map((values, k) =>
        Number.isFinite(values[i]) ? values[i] : this.#q[i] + (k === 0 ? -Math.PI : Math.PI),
      );
      if (Number(slider.min) !== lower) slider.min = String(lower);
      if (Number(slider.max) !== upper) slider.max = String(upper);
      slider.value = String(this.#q[i]);
    });
  }

  /** Says so where the picture is old; the next frame that counts replaces it. */
  tellLine() {
    const { link } = this;
    if (link.isOpen && !link.isSilent) return;
    this.note.textContent = `${link.isOpen ? 'No data' : 'No connection'}: the picture is old`;
    this.note.dataset.hand = '3';
    this.note.classList.remove('limited');
    for (const slider of this.sliders ?? []) slider.disabled = true;
  }

  /** The limits that have acted of late, while the hand moves the arm. */
  #keepActing(frame, isMoving) {
    const now = performance.now();
    for (const limit of isMoving ? limitsOf(frame, this.run).filter(Boolean) : []) this.#acted.set(limit, now);
    for (const [limit, at] of this.#acted) if (now - at > NAMED_MS || !isMoving) this.#acted.delete(limit);
  }

  show(frame, state) {
    this.#q = [...frame('q')];
    if (this.sliders && !this.hand.isPressed) this.#placeSliders(frame);
    for (const slider of this.sliders ?? []) slider.disabled = !(state === 'running' && this.link.isOperator && !this.link.isSilent);
    const [[hand], [refusal]] = [frame('hand'), frame('refusal')];
    const isRunning = state === 'running';
    this.#keepActing(frame, isRunning && hand === 1);
    if (this.link.isSilent || performance.now() - this.last < PERIOD_MS) return;
    this.last = performance.now();
    if (!this.run.moves) {
      this.note.textContent = '';
      return;
    }
    const acting = [...this.#acted.keys()];
    if (!this.hand.isPressed || hand !== 0) this.unheardSince = performance.now();
    let text = '';
    if (state === 'armed') text = this.link.isOperator ? 'Press Start: the arm is held.' : 'Take control, then Start.';
    else if (state === 'stopping') text = 'The arm brakes to rest, and the program ends.';
    else if (isRunning && !this.link.isOperator) text = 'You watch. Take control to move the arm.';
    else if (isRunning && hand === 3) text = `${HANDS[hand]}: ${REFUSALS[refusal] ?? ''}. Let go and press again.`;
    else if (isRunning && hand === 1) text = [HANDS[hand], [...new Set(acting.map(nameOf))].join(', ')].filter(Boolean).join(', held back by ');
    else if (isRunning && performance.now() - this.unheardSince > PATIENCE_MS) text = NOT_FOLLOWED;
    else if (isRunning) text = HANDS[hand] ?? '';
    if (this.note.textContent !== text) this.note.textContent = text;
    const isMine = isRunning && this.link.isOperator;
    this.note.dataset.hand = !isMine ? '' : text === NOT_FOLLOWED ? '2' : String(hand);
    const isLimited = isMine && acting.length > 0;
    this.note.classList.toggle('limited', isLimited);
    if (isLimited) this.note.style.setProperty('--key', limitColour(acting[0]));
  }
}

/** Each joint between its limits, where its stop would leave it, and which limit acts. */
export class JointPanel {
  constructor(host, run) {
    this.run = run;
    this.last = 0;
    this.rows = run.joints.map(({ name }, i) => {
      const mark = el('span.gauge-mark');
      const rest = el('span.gauge-mark.rest');
      const value = el('td.number');
      const speed = el('span.gauge-mark');
      const acting = el('td.acting');
      const row = el(
        'tr',
        el('th', { scope: 'row' }, swatch(i), name),
        value,
        el('td', el('span.gauge', rest, mark)),
        el('td', el('span.gauge', speed)),
        acting,
      );
      return { row, mark, rest, value, speed, acting };
    });
    const heads = ['', run.joints.some(({ linear }) => linear) ? 'q [rad, m]' : 'q [rad]', 'position', 'velocity', 'limit that acts'];
    host.append(
      el('div.card-head', el('h2', { text: 'Joints' })),
      table({ class: 'joints' }, heads.map((text) => el('th', { scope: 'col', text })), this.rows.map(({ row }) => row)),
    );
  }

  show(frame) {
    if (performance.now() - this.last < PERIOD_MS) return;
    this.last = performance.now();
    const acting = limitsOf(frame, this.run);
    const place = (mark, value, lower, upper) => {
      const share = (value - lower) / (upper - lower);
      mark.hidden = !Number.isFinite(share);
      mark.style.setProperty('left', `${Math.min(100, Math.max(0, 100 * share))}%`);
    };
    this.rows.forEach(({ mark, rest, value, speed, acting: cell }, i) => {
      const [lower, upper] = [frame('position_lower')[i], frame('position_upper')[i]];
      value.textContent = fixed(frame('q')[i], 3);
      place(mark, frame('q')[i], lower, upper);
      place(rest, frame('rest_q')[i], lower, upper);
      place(speed, frame('qd')[i], frame('velocity_lower')[i], frame('velocity_upper')[i]);
      const name = acting[i];
      cell.textContent = name ? nameOf(name) : '';
      if (name) cell.style.setProperty('--key', limitColour(name));
    });
  }
}

/** What the real arm touches, or null. */
export function contactOf(frame, { obstacles }) {
  const pressing = frame('pressing')[0];
  if (!(pressing > 0)) return null;
  return { pressing, force: frame('force'), point: frame('touched_at'), obstacle: obstacles[frame('touched')[0]] ?? '?' };
}

/** Ticks, and how old what is seen is. */
export class TimePanel {
  constructor(host, run) {
    this.last = 0;
    this.run = run;
    this.cells = new Map();
    const rows = [['time', 'Time'], ['tick', 'Tick computed in'], ['worst', 'Slowest tick'], ['missed', 'Missed ticks']];
    if (run.moves === 'tool') rows.unshift(['error', 'Tool from target']);
    if (run.environment) rows.unshift(['clearance', 'Nearest']);
    if (run.hasContact) rows.unshift(['contact', 'Contact']);
    host.append(
      el('div.card-head', el('h2', { text: 'Now' })),
      el(
        'dl.facts',
        ...rows.flatMap(([key, text]) => {
          this.cells.set(key, el('dd'));
          return [el('dt', { text }), this.cells.get(key)];
        }),
      ),
    );
  }

  show(frame) {
    if (performance.now() - this.last < PERIOD_MS) return;
    this.last = performance.now();
    const one = (name) => frame(name)[0];
    const set = (key, text) => {
      const cell = this.cells.get(key);
      if (cell && cell.textContent !== text) cell.textContent = text;
    };
    set('time', `${fixed(one('time_s'), 1)} s`);
    set('tick', `${fixed(one('compute_us'), 0)} of ${number(1e6 * this.run.tick_s)} µs`);
    set('worst', `${fixed(one('worst_us'), 0)} µs`);
    set('missed', `${one('missed')}${one('lost_rows') > 0 ? ', log too slow' : ''}`);
    const [tool, target] = [frame('tool'), frame('target')];
    const error = Math.hypot(...[0, 1, 2].map((i) => tool[i] - target[i]));
    set('error', `${fixed(1000 * error, 1)} mm`);
    const [link, obstacle, other] = frame('nearest');
    const { links, obstacles } = this.run;
    const name = obstacle >= 0 ? obstacles[obstacle] : links[other];
    const distance = one('clearance');
    const contact = contactOf(frame, this.run);
    set('contact', contact ? `${inNewtons(contact.pressing)}, ${contact.obstacle}` : '–');
    set('clearance', Number.isFinite(distance) ? `${Math.round(1000 * distance)} mm, ${links[link] ?? '?'} – ${name ?? '?'}` : '–');
  }
}

/** Shows and hides what is drawn, and the way back to the first view. */
export function viewHead(view, run, headset) {
  const parts = [
    ['stop', 'backup stop', 'Pale: where the arm would come to rest if the backup stop began now'],
    ...(run.environment ? [['obstacles', 'obstacles', 'What stands around the arm'], ['nearest', 'nearest points', 'Where the arm comes nearest to anything']] : []),
    ...(run.hasContact ? [['contact', 'force', 'What presses on the real arm']] : []),
  ];
  return el(
    'div.card-head',
    el('h2', { text: 'Arm' }),
    el(
      'span.chips',
      ...parts.map(([part, text, title]) => {
        const onclick = ({ currentTarget }) => setPressed(currentTarget, view.togglePart(part));
        return button({ class: 'chip', text, title, 'aria-pressed': 'true', onclick });
      }),
    ),
    el('span.push'),
    headset.controls(),
    iconButton('home', 'The first view', () => view.resetCamera()),
  );
}
