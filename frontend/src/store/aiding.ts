/** What is said while the autopilot is told where the vehicle is, and before. Pure. */

import type { Aiding, AidingCheck, AidingForm } from '../api/types';
import { withUnit } from '../geo/format';
import type { Words } from './words';

export const FORM_NAMES: Record<AidingForm, string> = {
  external_position: 'External position',
  odometry: 'Odometry',
  gps_input: 'GPS input (last resort)',
  global_position_sensor: 'Global position sensor',
};

export const FORM_DETAILS: Record<AidingForm, string> = {
  external_position: 'Once a second: the autopilot moves its position there, and only while its GPS is lost.',
  odometry: '20 times a second: position and velocity, for an autopilot that takes external navigation.',
  gps_input: 'LAST RESORT: pretends to be the GPS receiver. The autopilot cannot tell it from a real one.',
  global_position_sensor: 'Five times a second: EKF2 weighs it against the rest.',
};

/** Whether the autopilot uses what it is told, in one word or two. */
export function aidingEffect(aiding: Aiding | null): Words {
  if (!aiding?.on) return { text: 'off', detail: 'The autopilot is told nothing of where the vehicle is.', tone: 'none' };
  if (!aiding.sending) return { text: 'PAUSED', detail: `${aiding.reason}. It goes on by itself when that is over.`, tone: 'watch' };
  if (aiding.effect === 'used') return { text: 'USED', detail: aiding.effect_text, tone: 'good' };
  if (aiding.effect === 'not_used') return { text: 'NOT USED', detail: aiding.effect_text, tone: 'bad' };
  return { text: 'CANNOT TELL', detail: aiding.effect_text, tone: 'watch' };
}

/** How far the autopilot has itself from the estimate; empty where it does not say. */
export function aidingGap(aiding: Aiding | null): string {
  if (!aiding?.on || aiding.gap_now_m === null) return '';
  const now = `${withUnit(aiding.gap_now_m, 'm', 0)} off now`;
  return aiding.gap_began_m === null ? now : `${now}, ${withUnit(aiding.gap_began_m, 'm', 0)} when it began`;
}

/** Whether the autopilot's parameters allow it. */
export function checkWords(check: AidingCheck | null): Words {
  if (!check) return { text: 'not checked', detail: 'The vehicle is asked for its parameters.', tone: 'none' };
  const wrong = check.parameters.filter((row) => row.ok === false).length;
  const unknown = check.parameters.filter((row) => row.ok === null).length;
  if (wrong > 0) return { text: wrong === 1 ? '1 parameter is wrong' : `${wrong} parameters are wrong`, detail: '', tone: 'bad' };
  if (unknown > 0) return { text: unknown === 1 ? '1 parameter is not known' : `${unknown} parameters are not known`, detail: '', tone: 'watch' };
  return { text: 'parameters are right', detail: '', tone: 'good' };
}
