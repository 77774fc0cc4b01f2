/** Quantities in the units an operator chose. Everything inside stays in metres and metres a second; pure. */

import { DASH, formatNumber, withUnit, type Quantity } from './format';

export const LENGTH_UNITS = { m: 'Metres', ft: 'Feet' } as const;
export const SPEED_UNITS = { m_s: 'Metres a second', km_h: 'Kilometres an hour', kn: 'Knots' } as const;

export type LengthUnit = keyof typeof LENGTH_UNITS;
export type SpeedUnit = keyof typeof SPEED_UNITS;

export interface Units {
  length: LengthUnit;
  speed: SpeedUnit;
}

export const METRIC: Units = { length: 'm', speed: 'm_s' };
export const AVIATION: Units = { length: 'ft', speed: 'kn' };

// All exact by definition: the international foot, the nautical mile of 1852 m.
const FOOT_M = 0.3048;
const INCH_M = FOOT_M / 12;
const SPEED_PER_M_S: Record<SpeedUnit, number> = { m_s: 1, km_h: 3.6, kn: 3600 / 1852 };
const SPEED_NAMES: Record<SpeedUnit, string> = { m_s: 'm/s', km_h: 'km/h', kn: 'kn' };

/** How a quantity in its SI unit is shown: times `factor`, with so many decimals, and the name after it. */
export interface Shown {
  factor: number;
  digits: number;
  name: string;
}

export function lengthShown({ length }: Units, digits = 0): Shown {
  return length === 'ft' ? { factor: 1 / FOOT_M, digits, name: 'ft' } : { factor: 1, digits, name: 'm' };
}

export function speedShown({ speed }: Units, digits = 0): Shown {
  return { factor: SPEED_PER_M_S[speed], digits, name: SPEED_NAMES[speed] };
}

/** Climb and sink go with the heights: feet a minute beside feet. */
export function climbShown({ length }: Units, digits = 1): Shown {
  // A foot a minute is 5 mm/s.
  return length === 'ft' ? { factor: 60 / FOOT_M, digits: Math.max(0, digits - 2), name: 'ft/min' } : { factor: 1, digits, name: 'm/s' };
}

/** For what is smaller than a step: centimetres, or inches beside feet. */
export function smallShown({ length }: Units, digits = 1): Shown {
  return length === 'ft' ? { factor: 1 / INCH_M, digits, name: 'in' } : { factor: 100, digits, name: 'cm' };
}

export function inUnit(value: Quantity, shown: Shown): number | null {
  return typeof value === 'number' && Number.isFinite(value) ? value * shown.factor : null;
}

/** The number alone, where the unit stands elsewhere. */
export function numberIn(value: Quantity, shown: Shown): string {
  return formatNumber(inUnit(value, shown), shown.digits);
}

export function textIn(value: Quantity, shown: Shown): string {
  return withUnit(inUnit(value, shown), shown.name, shown.digits);
}

export function formatLength(value_m: Quantity, units: Units, digits = 0): string {
  return textIn(value_m, lengthShown(units, digits));
}

export function formatSpeed(value_m_s: Quantity, units: Units, digits = 0): string {
  return textIn(value_m_s, speedShown(units, digits));
}

export function formatClimb(value_m_s: Quantity, units: Units, digits = 1): string {
  return textIn(value_m_s, climbShown(units, digits));
}

/** "4.2 × 3.1 m": the semi-axes of an ellipse. */
export function formatAxes(ellipse: { semi_major_m: number; semi_minor_m: number } | null | undefined, units: Units, digits = 1): string {
  if (!ellipse) return DASH;
  const shown = lengthShown(units, digits);
  return `${numberIn(ellipse.semi_major_m, shown)} × ${textIn(ellipse.semi_minor_m, shown)}`;
}
