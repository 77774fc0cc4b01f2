/** Marks of the timeline that are no numbers: alarms, what the vehicle said, landings. Bounded. Pure. */

import type { Alarm, HistoryEvent, Severity, StationMessage } from '../api/types';

export type EventKind = HistoryEvent['kind'] | 'mode' | 'gps_denied' | 'target';

export interface TimeMark {
  id: string;
  t_us: number;
  kind: EventKind;
  /** Null where it concerns the station. */
  vehicle_id: string | null;
  severity: Severity;
  text: string;
}

const MARKS_KEPT = 2000;

export class EventBook {
  private marks: TimeMark[] = [];
  private readonly phases = new Map<string, string | null>();
  revision = 0;

  apply(message: StationMessage): void {
    if (message.type === 'hello') for (const alarm of message.alarms) this.alarm(alarm, message.t_unix_us);
    else if (message.type === 'alarm') this.alarm(message, message.t_unix_us);
    else if (message.type === 'landing') this.landing(message.vehicle_id, message.descent, message.t_unix_us);
  }

  /** What the station remembers; what is known is not doubled. */
  prime(events: readonly HistoryEvent[]): void {
    for (const { t_unix_us, kind, vehicle_id, severity, text, id } of events) {
      this.add({ id: `${kind}/${id}`, t_us: t_unix_us, kind, vehicle_id, severity, text });
    }
  }

  of(vehicle_id: string): TimeMark[] {
    return this.marks.filter((mark) => mark.vehicle_id === vehicle_id || mark.vehicle_id === null);
  }

  private alarm(alarm: Alarm, t_us: number): void {
    const kind = alarm.code === 'vehicle_text' ? 'said' : alarm.active ? 'alarm_raised' : 'alarm_cleared';
    const since_us = kind === 'alarm_cleared' ? t_us : (alarm.since_unix_us ?? t_us);
    const { vehicle_id, severity, text } = alarm;
    this.add({ id: `${kind}/${alarm.id}`, t_us: since_us, kind, vehicle_id, severity, text });
  }

  private landing(vehicle_id: string, descent: { phase: string; reason: string } | null, t_us: number): void {
    const phase = descent?.phase ?? null;
    const before = this.phases.get(vehicle_id);
    this.phases.set(vehicle_id, phase);
    // The first that is heard may have begun long before.
    if (before === undefined || phase === before || descent === null) return;
    const text = `landing: ${descent.phase}${descent.reason ? ` (${descent.reason})` : ''}`;
    this.add({ id: `landing/${vehicle_id}:${phase}:${t_us}`, t_us, kind: 'landing', vehicle_id, severity: 'info', text });
  }

  private add(mark: TimeMark): void {
    if (this.marks.some((other) => other.id === mark.id || twice(mark, other))) return;
    this.marks.push(mark);
    this.marks.sort((a, b) => a.t_us - b.t_us);
    if (this.marks.length > MARKS_KEPT) this.marks.shift();
    this.revision += 1;
  }
}

/** A landing's phase has no name of its own: heard and remembered, it is told within a second of itself. */
function twice(a: TimeMark, b: TimeMark): boolean {
  return a.kind === 'landing' && b.kind === 'landing' && a.vehicle_id === b.vehicle_id && a.text === b.text && Math.abs(a.t_us - b.t_us) < 1e6;
}
