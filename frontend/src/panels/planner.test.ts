import { beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiError } from '../api/client';
import type { Base, PlanApi } from '../api/plans';
import type { PlanPath, StationMessage } from '../api/types';
import type { PlanDocument } from '../store/plan';
import type { Fly } from './fly.svelte';
import { Planner } from './planner.svelte';

const A = { lat_deg: 58, lon_deg: 15 };
const B = { lat_deg: 58.001, lon_deg: 15 };

/** A station that keeps one plan; its ETags are numbers. */
function bench() {
  const station = { content: null as string | null, tag: 0, saves: [] as Base[] };
  const etag = () => (station.content === null ? null : String(station.tag));
  const put = (content: string) => {
    station.content = content;
    station.tag += 1;
  };
  const api = {
    fetch: async () => (station.content === null ? null : { document: JSON.parse(station.content) as PlanDocument, etag: etag()! }),
    keep: async (_id: string, content: string, base: Base) => {
      station.saves.push(base);
      if (base !== 'any' && base.etag !== etag()) throw new ApiError(412, 'Precondition Failed', 'changed');
      put(content);
      return etag()!;
    },
    path: async () => ({ properties: { etag: etag(), problems: [], warnings: [] } }) as unknown as PlanPath,
  } as unknown as PlanApi;
  return { station, put, planner: new Planner(api, {} as Fly) };
}

const settled = () => vi.advanceTimersByTimeAsync(1000);
const items = (plan: PlanDocument | null) => plan?.mission.items.length ?? null;

describe('the plan of a vehicle', () => {
  beforeEach(() => {
    vi.useFakeTimers();
  });

  it('is kept a moment after the last of several edits, each save on the one before', async () => {
    const { station, planner } = bench();
    planner.open('1');
    await settled();
    expect(planner.state).toBe('none');
    planner.tool = 'points';
    planner.click(A, null);
    planner.click(B, null);
    expect(planner.state).toBe('unsaved');
    await settled();
    expect([planner.state, station.saves]).toEqual(['saved', [{ etag: null }]]);
    planner.step('undo');
    await settled();
    expect([items(planner.document), station.saves[1]]).toEqual([1, { etag: '1' }]);
    planner.step('redo');
    await settled();
    expect([items(planner.document), items(JSON.parse(station.content!) as PlanDocument)]).toEqual([2, 2]);
  });

  it('does not overwrite what another page has kept, until it is told to', async () => {
    for (const keep of ['mine', 'theirs'] as const) {
      const { station, put, planner } = bench();
      planner.open('1');
      planner.tool = 'points';
      planner.click(A, null);
      await settled();
      planner.click(B, null);
      const theirs = { fileType: 'Plan', version: 1, mission: { version: 2, items: [] } };
      put(JSON.stringify(theirs));
      await settled();
      expect(planner.state).toBe('conflict');
      expect(JSON.parse(station.content!)).toEqual(theirs);
      await planner.resolve(keep);
      await settled();
      expect([planner.state, items(planner.document)]).toEqual(['saved', keep === 'mine' ? 2 : 0]);
      expect(items(JSON.parse(station.content!) as PlanDocument)).toBe(keep === 'mine' ? 2 : 0);
    }
  });

  it('follows another page where nothing is unsaved here, and undo brings the old one back', async () => {
    const { put, planner } = bench();
    planner.open('1');
    planner.tool = 'points';
    planner.click(A, null);
    await settled();
    put(JSON.stringify({ fileType: 'Plan', version: 1, mission: { version: 2, items: [] } }));
    planner.take({ type: 'plan', seq: 1, t_unix_us: 1, vehicle_id: '1', etag: '2' } as StationMessage);
    await settled();
    expect(items(planner.document)).toBe(0);
    planner.step('undo');
    expect(items(planner.document)).toBe(1);
  });

  it('of a replay there is none', async () => {
    const { planner } = bench();
    planner.open('replay-1');
    await settled();
    expect([planner.vehicle_id, planner.edit((plan) => plan)]).toEqual([null, false]);
  });
});
