import { expect, it } from 'vitest';
import type { StationMessage } from '../api/types';
import { WaitingMessages } from './coalesce';

const message = (fields: object) => fields as StationMessage;

it('keeps the latest state of each vehicle and every alarm', () => {
  const waiting = new WaitingMessages();
  waiting.put(message({ type: 'state', vehicle_id: '1', seq: 1 }));
  waiting.put(message({ type: 'alarm', id: 'a', seq: 2 }));
  waiting.put(message({ type: 'state', vehicle_id: '2', seq: 3 }));
  waiting.put(message({ type: 'alarm', id: 'a', seq: 4 }));
  waiting.put(message({ type: 'state', vehicle_id: '1', seq: 5 }));
  expect(waiting.take().map((m) => m.seq)).toEqual([2, 3, 4, 5]);
  expect(waiting.size).toBe(0);
});

it('keeps an accepted fix beside a later rejected one', () => {
  const waiting = new WaitingMessages();
  waiting.put(message({ type: 'fix', vehicle_id: '1', accepted: true, seq: 1 }));
  waiting.put(message({ type: 'fix', vehicle_id: '1', accepted: false, seq: 2 }));
  expect(waiting.take()).toHaveLength(2);
});

it("keeps what became of an operator's alignment", () => {
  const waiting = new WaitingMessages();
  waiting.put(message({ type: 'fix', kind: 'operator', vehicle_id: '1', accepted: true, seq: 1 }));
  waiting.put(message({ type: 'fix', kind: 'registration', vehicle_id: '1', accepted: true, seq: 2 }));
  expect(waiting.take().map((m) => m.seq)).toEqual([1, 2]);
});

it('does not grow while the page sleeps', () => {
  const waiting = new WaitingMessages();
  for (let seq = 0; seq < 10_000; seq++) waiting.put(message({ type: 'gps', vehicle_id: '1', seq }));
  expect(waiting.size).toBe(1);
});
