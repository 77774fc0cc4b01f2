import { expect, it } from 'vitest';
import type { StateMessage } from '../api/types';
import { StateHistory } from './history';

const state = (t_s: number, epoch = 0) => ({ t_unix_us: t_s * 1e6, epoch }) as StateMessage;

it('finds the nearest state, and none that is too far', () => {
  const history = new StateHistory();
  for (const t of [1, 1.1, 1.2]) history.append(state(t));
  expect(history.at(1.14e6)?.t_unix_us).toBe(1.1e6);
  expect(history.at(1.16e6)?.t_unix_us).toBe(1.2e6);
  expect(history.at(0.9e6)?.t_unix_us).toBe(1e6);
  expect(history.at(3e6)).toBeNull();
});

it('forgets the old and everything of another epoch', () => {
  const history = new StateHistory(10e6);
  for (let t = 0; t < 100; t++) history.append(state(t));
  expect(history.length).toBe(11);
  history.append(state(100, 1));
  expect(history.length).toBe(1);
});

it('goes by the time of the estimate, not of the message', () => {
  const history = new StateHistory();
  history.append({ t_unix_us: 9e15, t_state_unix_us: 5e6, epoch: 0 } as StateMessage);
  expect(history.at(5.1e6)).not.toBeNull();
});
