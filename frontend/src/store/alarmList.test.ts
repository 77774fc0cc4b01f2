import { describe, expect, it } from 'vitest';
import howto from '../../../docs/howto/alarms.md?raw';
import { ADVICE, loudAlarms, newAlarms, rankedAlarms, spokenAlarm } from './alarmList';
import type { AlarmEntry } from './mission';

function alarm(id: string, severity: AlarmEntry['severity'], raised_unix_us: number, active = true): AlarmEntry {
  return { id, vehicle_id: '1', severity, code: 'gps_lost', text: id, active, raised_unix_us, cleared_unix_us: active ? null : raised_unix_us + 1 };
}

const ALARMS = [alarm('watch', 'caution', 4), alarm('over', 'warning', 9, false), alarm('seen', 'warning', 5), alarm('old', 'warning', 1), alarm('new', 'warning', 3)];
const SEEN = new Set(['seen']);
const ids = (alarms: AlarmEntry[]) => alarms.map((one) => one.id);

describe('alarms', () => {
  it('stand in the order they are to be worked through', () => {
    expect(ids(rankedAlarms(ALARMS, SEEN))).toEqual(['new', 'old', 'watch', 'seen', 'over']);
  });

  it('are quiet when they are acknowledged or over', () => {
    expect(ids(loudAlarms(ALARMS, SEEN))).toEqual(['new', 'old', 'watch']);
    expect(loudAlarms(ALARMS, new Set(ids(ALARMS)))).toEqual([]);
  });

  it('are new once, also those that do not stand', () => {
    const after = [alarm('told', 'info', 11, false), ...ALARMS.map((one) => ({ ...one, active: false }))];
    expect(ids(newAlarms(ALARMS, after))).toEqual(['told']);
    expect(newAlarms(ALARMS, ALARMS)).toEqual([]);
  });

  it('are read out with how grave they are', () => {
    expect(spokenAlarm({ severity: 'warning', text: 'vehicle 1:  no GPS ' })).toBe('warning: vehicle 1: no GPS');
    expect(spokenAlarm({ severity: 'info', text: 'landed' })).toBe('landed');
  });

  it('have an advice for every code that the guide has, and no other', () => {
    const codes = [...howto.matchAll(/^\| ((?:`\w+`(?:, )?)+) \|/gm)].flatMap(([, cell]) => [...cell!.matchAll(/`(\w+)`/g)].map(([, code]) => code!));
    expect(codes.length).toBeGreaterThan(10);
    expect(Object.keys(ADVICE).sort()).toEqual(codes.sort());
  });
});
