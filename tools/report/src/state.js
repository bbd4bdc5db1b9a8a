import { Emitter } from './emitter.js';

/**
 * What the reader has chosen. Every part of the page changes it here and hears of changes from here:
 * `cases` (which are shown), `joint`, `kinds` (which lines of a quantity), `view` (the time in view), `time` (the
 * scrubber), `hover` (the mouse over a plot), `focus` (the case that is pointed at), `play`, `speed`, `replay` (whose
 * arm, and how), `theme`.
 */
export class State extends Emitter {
  constructor(run) {
    super();
    this.run = run;
    this.shown = run.cases.map(() => true);
    this.joint = 0; // an index, or ALL_JOINTS
    this.view = { min: run.tMin, max: run.tMax };
    this.time = run.tMin;
    this.hover = null;
    this.focus = null; // the index of the case that stands out
    this.playing = false;
    this.speed = 1;
    this.replayCase = defaultReplayCase(run); // an index, or ALL_CASES
    this.hiddenKinds = new Set(); // keys of series that are not drawn
    this.fitted = new Set(); // quantities whose y axis is fitted to all data, whatever the limits
    this.exaggeration = 1; // of the real arm's deviation in the replay
    this.linkColour = 'limits'; // of the replay: what the colour of a link tells, limits that act or its speed
    this.hiddenParts = new Set(); // of the replay: obstacles, stop, nearest
  }

  /** The cases that are shown. */
  get cases() {
    return this.run.cases.filter((c) => this.shown[c.index]);
  }

  /** The time that read-outs speak of: under the mouse, else the scrubber's. */
  get cursorTime() {
    return this.hover ?? this.time;
  }

  toggleCase(index) {
    if (index >= this.shown.length) return;
    this.shown[index] = !this.shown[index];
    this.emit('cases');
  }

  /** Shows one case alone; again: all. */
  toggleAlone(index) {
    const isAlone = this.shown.every((shown, i) => shown === (i === index));
    this.shown = this.shown.map((_, i) => isAlone || i === index);
    this.emit('cases');
  }

  setFocus(index) {
    if (index !== this.focus) this.set('focus', { focus: index });
  }

  setJoint(joint) {
    if (joint !== this.joint) this.set('joint', { joint });
  }

  stepJoint(step) {
    const count = this.run.joints.length;
    if (this.joint === ALL_JOINTS) this.setJoint(step > 0 ? 0 : count - 1);
    else this.setJoint((this.joint + step + count) % count);
  }

  toggleKind(key) {
    this.toggle('kinds', this.hiddenKinds, key);
  }

  setView(min, max) {
    const { run } = this;
    const least = 8 * Math.min(...run.cases.map((c) => c.tick));
    const width = Math.min(Math.max(max - min, least), run.tMax - run.tMin);
    const start = Math.min(Math.max((min + max - width) / 2, run.tMin), run.tMax - width);
    this.set('view', { view: { min: start, max: start + width } });
  }

  resetView() {
    this.setView(this.run.tMin, this.run.tMax);
  }

  /** Changes the time in view by a factor, about the cursor if it is in view. */
  zoom(factor) {
    const { min, max } = this.view;
    const inView = this.cursorTime >= min && this.cursorTime <= max;
    const centre = inView ? this.cursorTime : (min + max) / 2;
    this.setView(centre - (centre - min) * factor, centre + (max - centre) * factor);
  }

  get isZoomed() {
    return this.view.max - this.view.min < (this.run.tMax - this.run.tMin) * (1 - 1e-9);
  }

  setTime(time) {
    this.set('time', { time: Math.min(Math.max(time, this.run.tMin), this.run.tMax) });
  }

  setHover(time) {
    if (time !== this.hover) this.set('hover', { hover: time });
  }

  setPlaying(playing) {
    if (playing && this.time >= this.run.tMax) this.setTime(this.run.tMin);
    this.set('play', { playing });
  }
}

export const ALL_JOINTS = -1;
export const ALL_CASES = -1;

/** The arm to look at first: of a case that kept its guarantee, if there is one. */
function defaultReplayCase(run) {
  const good = run.cases.find((c) => c.guarantees && c.grade === 'good' && c.replay);
  return (good ?? run.cases.find((c) => c.replay) ?? run.cases[0]).index;
}
