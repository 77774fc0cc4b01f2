import { describe, expect, it } from 'vitest';
import type { Mode, StateMessage, Target } from '../api/types';
import type { TimeMark } from './events';
import { VehicleSeries } from './series';
import { bandsIn, fixCounts, flightView, liveView, marksIn, partOf, ticksIn, timeAt, viewOfWidth, viewWith, wordsAt } from './timeline';

const state = (t_s: number, mode: Mode, gps_denied = false) =>
  ({ type: 'state', vehicle_id: '1', t_unix_us: t_s * 1e6, t_state_unix_us: t_s * 1e6, epoch: 1, mode, gps_denied, lat_deg: 1, lon_deg: 1 }) as unknown as StateMessage;

function flown(): VehicleSeries {
  const series = new VehicleSeries();
  for (let t = 0; t < 10; t++) series.state(state(t, 'gps'));
  for (let t = 10; t < 20; t++) series.state(state(t, 'vision', true));
  for (let t = 40; t < 50; t++) series.state(state(t, 'vision', true));
  for (let t = 11; t < 15; t++) {
    series.fix({ type: 'fix', t_unix_us: t * 1e6, accepted: t % 2 === 0, reason: t % 2 ? 'ambiguous (2)' : null, lat_deg: null, lon_deg: null, cov_ne_m2: null } as never);
  }
  return series;
}

const view = { from_us: 0, to_us: 60e6 };

describe('windows', () => {
  it('hold the newest at the right, and a time of the past where it was', () => {
    expect(partOf(liveView(100e6, 60e6), 100e6)).toBeCloseTo(0.99);
    expect(viewWith(view, 30e6)).toBe(view);
    expect(viewWith(view, -5e6)).toEqual({ from_us: -5e6, to_us: 55e6 });
    expect(viewWith(view, 70e6)).toEqual({ from_us: 10e6, to_us: 70e6 });
    const wider = viewOfWidth(view, 15e6, 600e6);
    expect(partOf(wider, 15e6)).toBeCloseTo(0.25);
    expect(timeAt(view, 0.5)).toBe(30e6);
  });

  it('turn the pages of a flight', () => {
    expect(flightView(0, 50e6, 20e6, 60e6)).toEqual({ from_us: 0, to_us: 50e6 });
    expect(flightView(0, 200e6, 59e6, 60e6)).toEqual({ from_us: 0, to_us: 60e6 });
    expect(flightView(0, 200e6, 61e6, 60e6)).toEqual({ from_us: 60e6, to_us: 120e6 });
    expect(flightView(0, 200e6, 200e6, 60e6)).toEqual({ from_us: 140e6, to_us: 200e6 });
  });

  it('have round times', () => {
    expect(ticksIn({ from_us: 3.5e6, to_us: 63.5e6 }, 7).map((t) => t / 1e6)).toEqual([10, 20, 30, 40, 50, 60]);
    expect(ticksIn(liveView(1e12, 3600e6), 8).length).toBeLessThanOrEqual(8);
  });
});

describe('what a window shows', () => {
  it('bands of modes, with a hole where nothing was heard', () => {
    expect(bandsIn(flown(), view).map((band) => [band.mode, band.gps_denied, band.from_us / 1e6, band.to_us / 1e6])).toEqual([
      ['gps', false, 0, 10], ['vision', true, 10, 19], ['vision', true, 40, 49],
    ]);
    expect(bandsIn(flown(), { from_us: 12e6, to_us: 14e6 })).toHaveLength(1);
  });

  it('counts of accepted and refused fixes', () => {
    const { accepted, rejected } = fixCounts(flown(), view, 60);
    expect([accepted[12], accepted[14], rejected[11], rejected[13]]).toEqual([1, 1, 1, 1]);
    expect(fixCounts(flown(), { from_us: 12e6, to_us: 13.5e6 }, 2)).toEqual({ accepted: [1, 0], rejected: [0, 1] });
  });

  it('marks in order: changes of mode, of GPS, alarms and targets of this vehicle', () => {
    const alarm: TimeMark = { id: 'a', t_us: 12e6, kind: 'alarm_raised', vehicle_id: '1', severity: 'warning', text: 'no fix' };
    const target = (id: string, vehicle_id: string, t_unix_us: number | null) =>
      ({ id, properties: { vehicle_id, t_unix_us, created_unix_us: 5e6, name: id } }) as unknown as Target;
    const marks = marksIn('1', flown(), [alarm, { ...alarm, t_us: 90e6 }], [target('x', '1', 11e6), target('y', '2', 11e6), target('z', '1', null)], view);
    expect(marks.map(({ kind, t_us }) => [kind, t_us / 1e6])).toEqual([
      ['target', 5], ['mode', 10], ['gps_denied', 10], ['target', 11], ['alarm_raised', 12],
    ]);
  });

  it('words for the pointer', () => {
    const marks: TimeMark[] = [{ id: 'a', t_us: 13.1e6, kind: 'alarm_cleared', vehicle_id: '1', severity: 'warning', text: 'no fix' }];
    expect(wordsAt(flown(), marks, 13.2e6, 0.5e6)).toEqual(['cleared: no fix', 'fix refused: ambiguous', 'mode: vision']);
    expect(wordsAt(flown(), marks, 30e6, 0.5e6)).toEqual([]);
  });
});
