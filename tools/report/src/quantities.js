// What is plotted of a joint, and how. A line that is real is wide and pale, one that is commanded is thin.
const REAL = { width: 3, alpha: 0.38 };
const NOMINAL = { width: 1.4 };

const series = (key, label, style) => ({ key, label, style, samples: (c, joint) => c.samples(joint, key) });
const thousandths = (key, label, style) => ({ key, label, style, samples: (c, joint) => c.thousandths(joint, key) });

/**
 * @typedef {Object} Quantity
 * @property {string} id
 * @property {string} title
 * @property {[string, string]} units of a joint that turns and of one that slides
 * @property {Array<{key: string, label: string, style: Object, samples: Function}>} kinds the lines per case, first on top
 * @property {string} [limit] the prefix of its limits
 * @property {string} [realLimit] the prefix of the limits of the real joint, where the nominal arm has tighter ones
 * @property {string} [bound] how far the real joint may be from the nominal one: a band around the first kind, or the
 *   limit of an error
 * @property {boolean} [steps] held from tick to tick, where every tick is drawn
 * @property {string} [trip] beyond which measured error a run is ended
 * @property {boolean} [isError] a difference of real and nominal, in thousandths
 * @property {boolean} [ofArm] of the whole arm, the same for every joint
 * @property {boolean} [inThousandths] its limits are told in thousandths of the data's unit
 * @property {string} [limitName] what its limit is called
 * @property {boolean} [zero] zero is always in view
 */

/** A quantity of a moving joint, of the nominal arm and of the real one; its limits have its name. */
const motion = (id, title, units, key, more = {}) => ({
  id,
  title,
  units,
  limit: id,
  kinds: [series(`nominal_${key}`, 'nominal', NOMINAL), series(`real_${key}`, 'real', REAL)],
  ...more,
});

/** A quantity of a joint that has no limits of its own. */
const ofJoint = (id, title, units, kinds, more = {}) => ({ id, title, units, zero: true, kinds, ...more });

/** A quantity of the whole arm, in one unit. */
const ofArm = (id, title, unit, kinds, more = {}) =>
  ofJoint(id, title, [unit, unit], kinds, { ofArm: true, ...more });

/** @type {Quantity[]} */
const QUANTITIES = [
  ofArm('tool', 'Distance of the tool from its command', 'mm', [
    thousandths('tool_nominal', 'nominal', NOMINAL),
    thousandths('tool_real', 'real', REAL),
  ]),
  motion('position', 'Position', ['rad', 'm'], 'q', { realLimit: 'real_position', bound: 'bound_position' }),
  motion('velocity', 'Velocity', ['rad/s', 'm/s'], 'qd', { realLimit: 'real_velocity', bound: 'bound_velocity' }),
  motion('acceleration', 'Acceleration', ['rad/s²', 'm/s²'], 'qdd'),
  motion('jerk', 'Jerk', ['rad/s³', 'm/s³'], 'jerk', {
    steps: true,
    kinds: [series('nominal_jerk', 'nominal', NOMINAL), series('real_jerk', 'real, from the encoders', REAL)],
  }),
  ofJoint('torque', 'Torque', ['Nm', 'N'], [
    series('tau_filter', 'filter', NOMINAL),
    series('tau_desired', 'desired', { width: 1, dash: [2, 2], alpha: 0.8 }),
    series('tau_robust', 'robust', { width: 1, dash: [6, 3] }),
    series('tau_motor', 'motor', REAL),
    series('tau_external', 'external push', { width: 1.6, dash: [1, 2] }),
  ]),
  ofJoint(
    'error',
    'Real minus nominal position',
    ['mrad', 'mm'],
    [thousandths('error_true', 'true', NOMINAL), thousandths('error', 'measured', REAL)],
    { bound: 'bound_position', trip: 'bound_measured', isError: true },
  ),
  ofJoint(
    'velocity_error',
    'Real minus nominal velocity, true',
    ['mrad/s', 'mm/s'],
    [thousandths('error_velocity', 'velocity error', NOMINAL)],
    { bound: 'bound_velocity', isError: true },
  ),
  ofJoint('margin', 'Margin of the backup stop', ['rad', 'm'], [series('margin', 'margin', NOMINAL)]),
  ofArm(
    'clearance',
    'Clearance on the way through tick and stop',
    'mm',
    [thousandths('clearance', 'clearance', NOMINAL)],
    { limit: 'clearance', limitName: 'safety distance', inThousandths: true },
  ),
  ofArm('contact', 'Contact force', 'N', [series('pressing', 'pressing force', NOMINAL)]),
];

/** What there is to plot of a run: a run without a real arm has no lines of one. */
export function quantitiesOf(run) {
  const exists = (kind) => run.cases.some((c) => run.joints.some((_, j) => kind.samples(c, j) !== null));
  return QUANTITIES.map((quantity) => ({ ...quantity, kinds: quantity.kinds.filter(exists) })).filter(
    ({ kinds }) => kinds.length > 0,
  );
}

/** Whether any case has a constant of a joint, such as a bound. */
export const anyHas = (run, key) => run.cases.some((c) => run.joints.some((_, j) => c.samples(j, key) !== null));

/** The key by which the band around a quantity's nominal line is shown and hidden. */
export const bandOf = ({ id }) => `${id}_band`;

/** Lines that are not drawn until the reader asks for them. */
export const HIDDEN_AT_FIRST = ['real_jerk', 'tau_robust', 'tau_motor'];
