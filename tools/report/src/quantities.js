// What is plotted of a joint, and how. A line that is real is wide and pale, one that is commanded is thin.
const REAL = { width: 3, alpha: 0.38 };
const NOMINAL = { width: 1.4 };

const series = (key, label, style) => ({ key, label, style, samples: (c, joint) => c.samples(joint, key) });

/**
 * @typedef {Object} Quantity
 * @property {string} id
 * @property {string} title
 * @property {[string, string]} units of a joint that turns and of one that slides
 * @property {Array<{key: string, label: string, style: Object, samples: Function}>} kinds the lines per case, first on top
 * @property {string} [limit] the prefix of its limits
 * @property {boolean} [steps] held from tick to tick, where every tick is drawn
 * @property {boolean} [zero] zero is always in view
 */

/** @type {Quantity[]} */
const QUANTITIES = [
  {
    id: 'position',
    title: 'Position',
    units: ['rad', 'm'],
    limit: 'position',
    kinds: [series('nominal_q', 'nominal', NOMINAL), series('real_q', 'real', REAL)],
  },
  {
    id: 'velocity',
    title: 'Velocity',
    units: ['rad/s', 'm/s'],
    limit: 'velocity',
    kinds: [series('nominal_qd', 'nominal', NOMINAL), series('real_qd', 'real', REAL)],
  },
  {
    id: 'acceleration',
    title: 'Acceleration',
    units: ['rad/s²', 'm/s²'],
    limit: 'acceleration',
    kinds: [series('nominal_qdd', 'nominal', NOMINAL), series('real_qdd', 'real', REAL)],
  },
  {
    id: 'jerk',
    title: 'Jerk',
    units: ['rad/s³', 'm/s³'],
    limit: 'jerk',
    steps: true,
    kinds: [series('nominal_jerk', 'nominal', NOMINAL), series('real_jerk', 'real, from the encoders', REAL)],
  },
  {
    id: 'torque',
    title: 'Torque',
    units: ['Nm', 'N'],
    zero: true,
    kinds: [
      series('tau_filter', 'filter', NOMINAL),
      series('tau_desired', 'desired', { width: 1, dash: [2, 2], alpha: 0.8 }),
      series('tau_robust', 'robust', { width: 1, dash: [6, 3] }),
      series('tau_motor', 'motor', REAL),
    ],
  },
  {
    id: 'error',
    title: 'Real minus nominal position',
    units: ['mrad', 'mm'],
    zero: true,
    kinds: [{ key: 'error', label: 'error', style: NOMINAL, samples: (c, joint) => c.trackingError(joint) }],
  },
  {
    id: 'margin',
    title: 'Margin of the stored stop',
    units: ['rad', 'm'],
    zero: true,
    kinds: [series('margin', 'margin', NOMINAL)],
  },
];

/** What there is to plot of a run: a run without a real arm has no lines of one. */
export function quantitiesOf(run) {
  const exists = (kind) => run.cases.some((c) => run.joints.some((_, j) => kind.samples(c, j) !== null));
  return QUANTITIES.map((quantity) => ({ ...quantity, kinds: quantity.kinds.filter(exists) })).filter(
    ({ kinds }) => kinds.length > 0,
  );
}

/** Lines that are not drawn until the reader asks for them. */
export const HIDDEN_AT_FIRST = ['real_jerk', 'tau_robust', 'tau_motor'];
