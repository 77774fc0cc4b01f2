/** What the operator has acknowledged, and what is read out. */

import { loudAlarms, newAlarms, rankedAlarms, spokenAlarm } from '../store/alarmList';
import type { AlarmEntry } from '../store/mission';

const STORED_AS = 'pilotage.acknowledged';
const KEPT = 200;

function stored(): string[] {
  try {
    const value: unknown = JSON.parse(localStorage.getItem(STORED_AS) ?? '[]');
    return Array.isArray(value) ? value.filter((id): id is string => typeof id === 'string') : [];
  } catch {
    return [];
  }
}

/** Reads aloud in the browser's own voice; a warning does not wait for what is being said. */
export function speak(text: string, urgent: boolean): void {
  if (typeof speechSynthesis === 'undefined') return;
  if (urgent) speechSynthesis.cancel();
  const utterance = new SpeechSynthesisUtterance(text);
  utterance.lang = 'en';
  speechSynthesis.speak(utterance);
}

export class AlarmDesk {
  /** Identities hold across a reload: they are the station's. */
  acknowledged = $state.raw<ReadonlySet<string>>(new Set(stored()));
  private alarms = $state.raw<readonly AlarmEntry[]>([]);

  ranked = $derived(rankedAlarms(this.alarms, this.acknowledged));
  loud = $derived(loudAlarms(this.alarms, this.acknowledged));
  quiet = $derived(this.alarms.filter((alarm) => alarm.active && this.acknowledged.has(alarm.id)));

  constructor(private readonly isSpoken: () => boolean) {}

  take(alarms: readonly AlarmEntry[]): void {
    if (alarms === this.alarms) return;
    const fresh = newAlarms(this.alarms, alarms).filter((alarm) => !this.acknowledged.has(alarm.id));
    this.alarms = alarms;
    // The newest is first in the list, and is told last.
    if (this.isSpoken()) for (const alarm of fresh.reverse()) speak(spokenAlarm(alarm), alarm.severity === 'warning' && fresh.length === 1);
  }

  acknowledge(...alarms: readonly AlarmEntry[]): void {
    const ids = [...this.acknowledged, ...alarms.map((alarm) => alarm.id)].slice(-KEPT);
    this.acknowledged = new Set(ids);
    if (typeof speechSynthesis !== 'undefined') speechSynthesis.cancel();
    try {
      localStorage.setItem(STORED_AS, JSON.stringify(ids));
    } catch {
      // Then it is forgotten with the page.
    }
  }
}
