/** What was commanded lately and what became of it, in a pilot's words. Pure; times are the page's own, in ms. */

import type { AckMessage } from '../api/types';

const KEPT = 12;
/** A vehicle's own words come beside its refusal, a moment before it or after. */
const BELONGS_MS = 3000;

export type CommandState = 'sending' | 'pending' | 'in_progress' | 'accepted' | 'rejected' | 'timeout';

export interface CommandEntry {
  /** Of this page, from before the station has given an id. */
  readonly key: string;
  readonly command_id: string | null;
  readonly vehicle_id: string;
  readonly words: string;
  readonly state: CommandState;
  /** Why it was refused, or how far it has come. */
  readonly reason: string;
  /** What the vehicle itself said about it. */
  readonly heard: string;
  readonly asked_ms: number;
  readonly changed_ms: number;
}

/** Newest first. */
export type CommandLog = readonly CommandEntry[];

const NAMES: Record<string, string> = {
  arm: 'Arm',
  disarm: 'Disarm',
  takeoff: 'Take off',
  goto: 'Go to',
  orbit: 'Orbit',
  hold: 'Hold position',
  return: 'Return home',
  land: 'Land',
  start_mission: 'Fly the mission',
  inject_failure: 'Simulated failure',
  track_point: 'Track a point',
  track_stop: 'Stop tracking',
  plan_upload: 'Send the plan',
  plan_download: 'Fetch the plan',
  plan_compare: 'Compare the plan',
  plan_clear: 'Clear the mission',
};

const STATES: Record<string, CommandState> = { accepted: 'accepted', in_progress: 'in_progress', timeout: 'timeout' };

const REASONS: Record<string, string> = {
  temporarily_rejected: 'not now: the autopilot is not ready for it',
  denied: 'the autopilot denied it',
  unsupported: 'this autopilot does not know the command',
  failed: 'the autopilot tried and failed',
  cancelled: 'cancelled',
  timeout: 'no answer from the aircraft: it may not have heard it',
};

export const STATE_WORDS: Record<CommandState, string> = {
  sending: 'Sending',
  pending: 'Pending',
  in_progress: 'In progress',
  accepted: 'Accepted',
  rejected: 'Rejected',
  timeout: 'Timed out',
};

export const STATE_TONES: Record<CommandState, 'none' | 'watch' | 'good' | 'bad'> = {
  sending: 'none',
  pending: 'watch',
  in_progress: 'watch',
  accepted: 'good',
  rejected: 'bad',
  timeout: 'bad',
};

export function commandName(command: string): string {
  return NAMES[command] ?? command.replaceAll('_', ' ');
}

export function isOpen(entry: CommandEntry): boolean {
  return entry.state === 'sending' || entry.state === 'pending' || entry.state === 'in_progress';
}

/** What stands beside the state; empty where there is nothing to say. */
export function reasonOf(entry: CommandEntry): string {
  const failed = entry.state === 'rejected' || entry.state === 'timeout';
  return failed && entry.heard ? `${entry.reason} (“${entry.heard}”)` : entry.reason;
}

export function asked(log: CommandLog, key: string, vehicle_id: string, words: string, now_ms: number): CommandLog {
  const entry: CommandEntry = {
    key, command_id: null, vehicle_id, words, state: 'sending', reason: '', heard: '', asked_ms: now_ms, changed_ms: now_ms,
  };
  return [entry, ...log].slice(0, KEPT);
}

/** The station has taken it. Its acknowledgement may have been here first. */
export function sent(log: CommandLog, key: string, command_id: string): CommandLog {
  const early = log.find((entry) => entry.command_id === command_id && entry.key !== key);
  return log
    .filter((entry) => entry !== early)
    .map((entry) => {
      if (entry.key !== key) return entry;
      const { state, reason, heard, changed_ms } = early ?? { ...entry, state: 'pending' as const };
      return { ...entry, command_id, state, reason, heard: heard || entry.heard, changed_ms };
    });
}

/** The station itself has refused it, or was not reached. */
export function refused(log: CommandLog, key: string, reason: string, now_ms: number): CommandLog {
  return log.map((entry) => (entry.key === key ? { ...entry, state: 'rejected', reason, changed_ms: now_ms } : entry));
}

/** One that nobody here has asked for comes from another page or a program, and is shown as well. */
export function acknowledged(log: CommandLog, ack: AckMessage, now_ms: number): CommandLog {
  const state = STATES[ack.status] ?? 'rejected';
  const reason = reasonWords(ack, state);
  if (log.some((entry) => entry.command_id === ack.command_id)) {
    return log.map((entry) => (entry.command_id === ack.command_id ? { ...entry, state, reason, changed_ms: now_ms } : entry));
  }
  const entry: CommandEntry = {
    key: ack.command_id, command_id: ack.command_id, vehicle_id: ack.vehicle_id, words: commandName(ack.command), state, reason,
    heard: '', asked_ms: now_ms, changed_ms: now_ms,
  };
  return [entry, ...log].slice(0, KEPT);
}

/** A warning of the vehicle's own, kept with the command that it is likely about: the newest that is open or just ended. */
export function heard(log: CommandLog, vehicle_id: string, text: string, now_ms: number): CommandLog {
  const about = log.find((entry) => entry.vehicle_id === vehicle_id && (isOpen(entry) || now_ms - entry.changed_ms < BELONGS_MS));
  return about ? log.map((entry) => (entry === about ? { ...entry, heard: text } : entry)) : log;
}

/** Operations on plans explain themselves; of a plain command MAVLink tells no more than a number. */
function reasonWords(ack: AckMessage, state: CommandState): string {
  if (ack.command.startsWith('plan_')) return ack.text;
  if (state === 'accepted' || state === 'in_progress') return '';
  return REASONS[ack.status] ?? ack.text;
}
