/** Messages that wait for a busy page. Pure. */

import type { StationMessage } from '../api/types';

/** Of these only the latest of each vehicle or source matters; all others are kept, in order. */
export function coalescingKey(message: StationMessage): string | null {
  switch (message.type) {
    case 'state':
    case 'gps':
    case 'telemetry':
    case 'link':
    case 'replay':
    case 'replay_preparing':
    case 'landing':
    case 'homing':
    case 'aiding':
      return `${message.type}/${message.vehicle_id}`;
    case 'fix':
      // What became of an operator's alignment is an answer.
      return message.kind === 'operator' ? null : `fix/${message.vehicle_id}/${message.accepted}`;
    case 'video':
      return `video/${message.source}`;
    case 'waiting':
    case 'pong':
    case 'recording':
      return message.type;
    default:
      return null;
  }
}

export class WaitingMessages {
  private readonly queue = new Map<unknown, StationMessage>();

  get size(): number {
    return this.queue.size;
  }

  put(message: StationMessage): void {
    const key = coalescingKey(message) ?? Symbol();
    // Deleted first, so that a replaced message takes its place at the end.
    this.queue.delete(key);
    this.queue.set(key, message);
  }

  take(): StationMessage[] {
    const batch = [...this.queue.values()];
    this.queue.clear();
    return batch;
  }
}
