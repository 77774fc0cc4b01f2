/** States of one vehicle over the last minutes, so that a paused picture is shown with the attitude of its own time. */

import type { StateMessage } from '../api/types';

/** When the estimate is for; an older station says only when it was sent. */
export function stateTime_us(state: StateMessage): number {
  return state.t_state_unix_us ?? state.t_unix_us;
}

export class StateHistory {
  private states: StateMessage[] = [];

  constructor(private readonly keep_us: number = 120_000_000) {}

  get length(): number {
    return this.states.length;
  }

  append(state: StateMessage): void {
    const last = this.states[this.states.length - 1];
    if (last && (last.epoch !== state.epoch || stateTime_us(last) > stateTime_us(state))) this.states = [];
    this.states.push(state);
    const oldest_us = stateTime_us(state) - this.keep_us;
    let stale = 0;
    while (stateTime_us(this.states[stale]!) < oldest_us) stale++;
    if (stale > 0) this.states.splice(0, stale);
  }

  /** The nearest state within `within_us`, or null. */
  at(t_unix_us: number, within_us = 500_000): StateMessage | null {
    let low = 0;
    let high = this.states.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (stateTime_us(this.states[middle]!) < t_unix_us) low = middle + 1;
      else high = middle;
    }
    const after = this.states[low];
    const before = this.states[low - 1];
    const distance = (state: StateMessage | undefined) => (state ? Math.abs(stateTime_us(state) - t_unix_us) : Infinity);
    const nearest = distance(before) <= distance(after) ? before : after;
    return nearest && distance(nearest) <= within_us ? nearest : null;
  }
}
