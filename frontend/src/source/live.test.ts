import { expect, it } from 'vitest';
import type { StationMessage } from '../api/types';
import { Pump, socketUrl } from './live';

it('builds socket addresses beside the page', () => {
  expect(socketUrl('http://127.0.0.1:8700/', 'api/v1/stream')).toBe('ws://127.0.0.1:8700/api/v1/stream');
  expect(socketUrl('https://station/x/?codec=jpeg', 'api/v1/stream')).toBe('wss://station/x/api/v1/stream');
});

it('hands over one batch at a time and coalesces what comes meanwhile', async () => {
  const batches: number[][] = [];
  let release: () => void = () => undefined;
  const pump = new Pump({
    messages: (batch) => {
      batches.push(batch.map((m) => m.seq));
      return new Promise<void>((resolve) => {
        release = resolve;
      });
    },
  });
  const state = (seq: number) => ({ type: 'state', vehicle_id: '1', seq }) as StationMessage;
  pump.put(state(1));
  pump.put(state(2));
  pump.put({ type: 'alarm', id: 'a', seq: 3 } as StationMessage);
  pump.put(state(4));
  expect(batches).toEqual([[1]]);
  release();
  await Promise.resolve();
  await Promise.resolve();
  expect(batches).toEqual([[1], [3, 4]]);
  release();
});
