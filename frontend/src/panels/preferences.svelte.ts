/** The settings of this page: read when it opens, kept with every change, laid on the document. */

import type { Units } from '../geo/units';
import { defaults, parseOldPreferences, parseSettings, writeSettings, type ReadSettings, type Settings } from '../store/settings';

const STORED_AS = 'pilotage.settings';
const OLD_STORED_AS = 'pilotage.preferences';

function stored(): ReadSettings {
  try {
    const text = localStorage.getItem(STORED_AS);
    if (text !== null) return parseSettings(text);
    const old = localStorage.getItem(OLD_STORED_AS);
    return old === null ? { settings: defaults(), faults: [] } : parseOldPreferences(old);
  } catch {
    return { settings: defaults(), faults: ['this browser keeps nothing for this page'] };
  }
}

export class Preferences {
  settings = $state.raw<Settings>(defaults());
  /** What was wrong with the kept settings when the page opened. */
  readonly faults: string[];
  private readonly dimmed = matchMedia('(prefers-color-scheme: light)');
  private readonly still = matchMedia('(prefers-reduced-motion: reduce)');

  units = $derived<Units>({ length: this.settings.length, speed: this.settings.speed });

  constructor() {
    const { settings, faults } = stored();
    this.settings = settings;
    this.faults = faults;
    this.dress();
    this.dimmed.addEventListener('change', () => this.dress());
    this.still.addEventListener('change', () => this.dress());
  }

  set(changed: Partial<Settings>): void {
    this.settings = { ...this.settings, ...changed };
    this.dress();
    try {
      localStorage.setItem(STORED_AS, writeSettings(this.settings));
    } catch {
      // A browser without storage forgets, and that is all.
    }
  }

  /** Takes the settings of a file; gives what was not understood. Nothing is changed when none of it was. */
  take(text: string): string[] {
    const { settings, faults } = parseSettings(text);
    if (faults.length !== 1 || !['not JSON', 'no version', 'not settings of this page'].includes(faults[0]!)) this.set(settings);
    return faults;
  }

  reset(): void {
    this.set(defaults());
  }

  private dress(): void {
    const { theme, motion } = this.settings;
    const root = document.documentElement;
    root.dataset['theme'] = theme === 'system' ? (this.dimmed.matches ? 'light' : 'dark') : theme;
    root.dataset['motion'] = motion === 'reduced' || this.still.matches ? 'reduced' : 'full';
  }
}
