const SVG = 'http://www.w3.org/2000/svg';

/**
 * Creates an element. Strings, as `text` or as children, always become text, never markup.
 * @param {string} kind the tag, with classes as a style sheet has them: "p.hint"
 * @param {...(Object|Node|string|null)} children before them perhaps the properties: `class`, `text`, `style` (custom
 *   properties), `on<event>`, else attributes; null and false leave an attribute out
 */
export function el(kind, ...children) {
  const [tag, ...classes] = kind.split('.');
  const element = document.createElement(tag);
  if (classes.length > 0) element.className = classes.join(' ');
  const properties = Object.getPrototypeOf(children[0] ?? '') === Object.prototype ? children.shift() : {};
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'text') element.textContent = value;
    else if (name === 'style') for (const [key, v] of Object.entries(value)) element.style.setProperty(key, v);
    else if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? '' : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const part = (id) => document.getElementById(id);

/** Starts the page of a report. What goes wrong is told as `explain(error)` says; the message is text, whatever it holds. */
export function startPage(start, explain) {
  const tell = (error) => {
    part('loading').hidden = true;
    part('message').textContent = explain(error);
    part('message').hidden = false;
  };
  addEventListener('error', (event) => tell(event.error ?? event.message));
  addEventListener('unhandledrejection', (event) => tell(event.reason));
  start().catch(tell);
}

const ICONS = {
  play: 'M5 3l9 5-9 5z',
  pause: 'M4 3h3v10H4zM9 3h3v10H9z',
  sun:
    'M8 5a3 3 0 100 6 3 3 0 000-6zM7.25 1h1.5v2.2h-1.5zM7.25 12.8h1.5V15h-1.5zM1 7.25h2.2v1.5H1z' +
    'M12.8 7.25H15v1.5h-2.2zM2.5 3.6l1-1 1.6 1.5-1.1 1zM10.9 11.9l1-1 1.6 1.5-1.1 1z' +
    'M11 4.1l1.5-1.6 1 1.1L12 5.1zM2.5 12.4l1.5-1.6 1.1 1.1-1.6 1.5z',
  moon: 'M6.2 1.5A6.7 6.7 0 1014.5 9.8 5.5 5.5 0 016.2 1.5z',
  plus: 'M7.25 3h1.5v4.25H13v1.5H8.75V13h-1.5V8.75H3v-1.5h4.25z',
  minus: 'M3 7.25h10v1.5H3z',
  reset: 'M2 3h1.5v10H2zM12.5 3H14v10h-1.5zM4.5 8l3-2.5v1.75h1V5.5L11.5 8l-3 2.5V8.75h-1v1.75z',
  home: 'M8 2l6.5 5.5-1 1.1-.9-.8V14H9.5v-4h-3v4H3.4V7.8l-.9.8-1-1.1z',
};

/** A path as a picture of its own. */
function drawing(viewBox, name, attributes) {
  const [svg, path] = ['svg', 'path'].map((tag) => document.createElementNS(SVG, tag));
  const set = (element, all) => Object.entries(all).forEach(([key, value]) => element.setAttribute(key, value));
  set(svg, { viewBox, 'aria-hidden': 'true', class: name });
  set(path, attributes);
  svg.append(path);
  return svg;
}

/** A small picture in the colour of the text around it. */
export const icon = (name) => drawing('0 0 16 16', 'icon', { d: ICONS[name] });

/** A short sample of a line, for a legend. */
export const lineSample = ({ width = 1.5, dash = [], alpha = 1 }) =>
  drawing('0 0 20 8', 'line-sample', { d: 'M1 4H19', 'stroke-width': width, 'stroke-opacity': alpha, 'stroke-dasharray': dash.join(' ') });

/** A button; properties and children as of el(). */
export const button = (properties, ...children) => el('button', { type: 'button', ...properties }, ...children);

/** A button that shows an icon and says what it does. */
export const iconButton = (name, label, onclick) =>
  button({ class: 'icon-button', 'aria-label': label, title: label, onclick }, icon(name));

/** What is pressed and what is not. */
export const setPressed = (element, isPressed) => element.setAttribute('aria-pressed', String(isPressed));

/** A list to choose from: `options` are pairs of value and text; `onchoose` hears the value, as a text. */
export function choice(properties, options, chosen, onchoose) {
  const select = el(
    'select',
    { ...properties, onchange: () => onchoose(select.value) },
    ...options.map(([value, text]) => el('option', { value, text })),
  );
  if (chosen !== null) select.value = String(chosen);
  return select;
}

/** A table of the cells of its head and of its rows. */
export const table = (properties, heads, rows) =>
  el('table', properties, el('thead', el('tr', ...heads)), el('tbody', ...rows));

/** What a page shows, and where that comes from. */
export const titles = (title, origin) =>
  el(
    'div.titles',
    el('h1', { text: title }),
    el('p.origin', ...origin.filter(Boolean).map((text) => el('span', { text }))),
  );

/** The list of the cases' verdicts. */
export const verdicts = (columns, items) =>
  el('ul.verdicts', { 'aria-label': 'Verdict per case', style: { '--columns': columns } }, ...items);

/** The verdict of a case: `kind` is ok, warn or bad, `said` an element; `more` stands below. */
export const verdictItem = (kind, c, said, ...more) =>
  el(
    'li',
    { class: `verdict ${kind}` },
    el('div.verdict-case', swatch(c.index), el('strong', { text: c.name })),
    el(
      'div.verdict-text',
      el('span.mark', { 'aria-hidden': 'true', text: { ok: '✓', bad: '✗', warn: '!' }[kind] }),
      said,
    ),
    ...more,
  );

/** Buttons that show and hide cases, as `shown()` says; `more` has what a button has besides. */
export function caseToggles(state, cases, event, shown, more = () => ({}), mark = () => null) {
  const buttons = cases.map((c, i) =>
    button(
      { class: 'case-toggle', style: caseStyle(i), title: `Show or hide ${c.name}`, onclick: () => state.toggleCase(i), ...more(c, i) },
      swatch(i),
      el('span.case-name', { text: c.name }),
      mark(i),
    ),
  );
  state.follow(event, () => buttons.forEach((one, i) => setPressed(one, shown()[i])));
  return el('div.cases', { role: 'group', 'aria-label': 'Cases' }, ...buttons);
}

/** The mark of a case: a square in its colour, striped or hollow where its lines are broken. */
export const swatch = (caseIndex) =>
  el('span', {
    class: `swatch${['', ' striped', ' hollow', ' ringed'][Math.floor(caseIndex / 8) % 4]}`,
    'aria-hidden': 'true',
    style: caseStyle(caseIndex),
  });

/** The custom property by which the style sheet knows the colour of a case. */
export const caseStyle = (caseIndex) => ({ '--case': `var(--case-${caseIndex % 8})` });

/** Tells the style sheet how high the bar at the top of the page is. */
export function tellHeight(bar) {
  const root = document.documentElement;
  new ResizeObserver(() => root.style.setProperty('--toolbar-height', `${bar.offsetHeight}px`)).observe(bar);
}

/** With a mouse a slider has the arrow keys only while it is held. */
export const freeKeys = (slider) => slider.addEventListener('pointerup', () => slider.blur());

/** Hands a file to the reader. */
export function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name.replace(/[^\p{L}\p{N}._-]+/gu, '_').slice(-120);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
