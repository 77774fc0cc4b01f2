/** Geometry of the head-up display, in units of a 640 by 480 drawing. Pure. */

export const HUD = { width: 640, height: 480, degree: 6, tapeDegree: 4, tapeHalf_deg: 35 } as const;

/** Moves and turns the horizon: it rolls against the aircraft and sinks when the nose rises. */
export function horizonTransform(roll_deg: number, pitch_deg: number): string {
  const cx = HUD.width / 2;
  const cy = HUD.height / 2;
  const shift = pitch_deg * HUD.degree;
  return `translate(${cx} ${cy}) rotate(${(-roll_deg).toFixed(2)}) translate(0 ${shift.toFixed(2)})`;
}

export interface TapeMark {
  x: number;
  label: string | null;
}

const CARDINALS: Record<number, string> = { 0: 'N', 45: 'NE', 90: 'E', 135: 'SE', 180: 'S', 225: 'SW', 270: 'W', 315: 'NW' };

/** Marks each 5 degrees about a heading, labelled each 15. */
export function headingTape(heading_deg: number): TapeMark[] {
  const marks: TapeMark[] = [];
  const first = Math.ceil((heading_deg - HUD.tapeHalf_deg) / 5) * 5;
  for (let mark = first; mark <= heading_deg + HUD.tapeHalf_deg; mark += 5) {
    const wrapped = ((mark % 360) + 360) % 360;
    const label = CARDINALS[wrapped] ?? (wrapped % 15 === 0 ? String(wrapped).padStart(3, '0') : null);
    marks.push({ x: HUD.width / 2 + (mark - heading_deg) * HUD.tapeDegree, label });
  }
  return marks;
}
