import { icon, iconButton } from './dom.js';
import { isDark, toggleTheme } from './theme.js';

/** Switches between light and dark colours. */
export function themeButton(state) {
  const button = iconButton('moon', 'Dark colours', toggleTheme);
  state.follow('theme', () => {
    const label = isDark() ? 'Light colours' : 'Dark colours';
    button.replaceChildren(icon(isDark() ? 'sun' : 'moon'));
    button.setAttribute('aria-label', label);
    button.title = label;
  });
  return button;
}
