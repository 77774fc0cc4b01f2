import { describe, expect, it } from 'vitest';
import type { HistoryEvent, StationMessage } from '../api/types';
import { EventBook } from './events';

const alarm = (active: boolean, t_unix_us: number, more: object = {}) =>
  ({ type: 'alarm', id: 'gps_lost:1:5', vehicle_id: '1', severity: 'warning', code: 'gps_lost', text: 'no fix', active, since_unix_us: 5, t_unix_us, ...more }) as StationMessage;
const landing = (phase: string | null, t_unix_us: number) =>
  ({ type: 'landing', vehicle_id: '1', t_unix_us, descent: phase === null ? null : { phase, reason: '' } }) as unknown as StationMessage;
const remembered = (kind: HistoryEvent['kind'], t_unix_us: number, id: string, text = 'no fix'): HistoryEvent => ({
  kind, t_unix_us, id, text, vehicle_id: '1', severity: 'warning',
});

describe('EventBook', () => {
  it('marks an alarm where it was raised and where it was cleared, once, however often it is told', () => {
    const book = new EventBook();
    book.apply(alarm(true, 7));
    book.apply(alarm(true, 9));
    book.apply(alarm(false, 30));
    book.prime([remembered('alarm_raised', 5, 'gps_lost:1:5'), remembered('alarm_cleared', 31, 'gps_lost:1:5'), remembered('alarm_raised', 2, 'other')]);
    expect(book.of('1').map(({ kind, t_us }) => [kind, t_us])).toEqual([['alarm_raised', 2], ['alarm_raised', 5], ['alarm_cleared', 30]]);
  });

  it('keeps the marks of vehicles apart, and shows those of the station with each', () => {
    const book = new EventBook();
    book.apply(alarm(true, 7, { id: 'disk', vehicle_id: null }));
    book.apply(alarm(true, 7, { id: 'b', vehicle_id: '2' }));
    expect(book.of('1').map((mark) => mark.id)).toEqual(['alarm_raised/disk']);
  });

  it('marks the phases of a landing that were seen to change, and none twice', () => {
    const book = new EventBook();
    for (const [phase, t] of [['hold', 0], ['descend', 1e6], ['descend', 2e6], ['landed', 9e6], [null, 10e6]] as const) book.apply(landing(phase, t));
    book.prime([remembered('landing', 8.9e6, '1:landed:8900000', 'landing: landed'), remembered('landing', -3e6, '1:hold:1', 'landing: hold')]);
    expect(book.of('1').map(({ text, t_us }) => [text, t_us])).toEqual([['landing: hold', -3e6], ['landing: descend', 1e6], ['landing: landed', 9e6]]);
  });

  it('stays bounded', () => {
    const book = new EventBook();
    for (let i = 0; i < 2100; i++) book.apply(alarm(true, i, { id: `a${i}`, since_unix_us: i }));
    expect(book.of('1').length).toBe(2000);
    expect(book.of('1')[0]!.t_us).toBe(100);
  });
});
