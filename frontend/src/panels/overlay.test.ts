import { describe, expect, it } from 'vitest';
import type { Alignment, StationApi } from '../api/client';
import type { Footprint } from '../api/types';
import { offsetBetween, offsetBy } from '../geo/earth';
import { MatchOverlay } from './overlay.svelte';

const HERE = { lat_deg: 58.49, lon_deg: 15.63 };
const GRID = {
  frame_id: 12, columns: 2, rows: 2, u_px: [0, 1], v_px: [0, 1], points: [null, [58.49, 15.63], [58.48, 15.62], [58.48, 15.63]],
} as unknown as Footprint;

function laid(align: (a: Alignment) => Promise<void>) {
  const api = { align: (_id: string, alignment: Alignment) => align(alignment) } as unknown as StationApi;
  const overlay = new MatchOverlay(api);
  overlay.on = true;
  overlay.laid = { vehicle_id: '1', picture: {} as HTMLCanvasElement, grid: GRID };
  return overlay;
}

describe('MatchOverlay', () => {
  it('hands over the sum of what was dragged and stepped, and draws it there', async () => {
    const sent: Alignment[] = [];
    const overlay = laid((a) => Promise.resolve(void sent.push(a)));
    overlay.moveBy(99, 99); // not before it is held
    overlay.adjust(true);
    overlay.drag(HERE, offsetBy(HERE, 12, -7));
    overlay.moveBy(-1, 0.2);
    const at = overlay.drawn!.grid.points[1]!;
    const moved = offsetBetween(HERE, { lat_deg: at[0]!, lon_deg: at[1]! });
    expect(moved.north_m).toBeCloseTo(11, 2);
    expect(moved.east_m).toBeCloseTo(-6.8, 2);
    await overlay.align();
    expect(sent).toHaveLength(1);
    expect(sent[0]).toMatchObject({ frame_id: 12, std_m: 3 });
    expect(sent[0]!.north_m).toBeCloseTo(11, 2);
    expect(overlay.adjusting).toBe(false);
    expect(overlay.drawn!.grid).toBe(GRID);
  });

  it('keeps the drag when the station refuses', async () => {
    const overlay = laid(() => Promise.reject(new Error('too far')));
    overlay.adjust(true);
    overlay.moveBy(500, 0);
    await expect(overlay.align()).rejects.toThrow('too far');
    expect([overlay.adjusting, overlay.shift.north_m]).toEqual([true, 500]);
  });

  it('cannot be held before it lies there', () => {
    const overlay = laid(() => Promise.resolve());
    overlay.clear();
    overlay.adjust(true);
    expect(overlay.adjusting).toBe(false);
  });
});
