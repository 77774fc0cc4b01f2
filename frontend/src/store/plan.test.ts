import { describe, expect, it } from 'vitest';
import { edgesOf, handlesOf, insertedAt, moved, pixelsFrom, removed } from './handles';
import * as plan from './plan';
import { NO_HISTORY, noted, redone, undone, type History } from './undo';

const A = { lat_deg: 58.5, lon_deg: 15.6 };
const B = { lat_deg: 58.501, lon_deg: 15.602 };
const C = { lat_deg: 58.502, lon_deg: 15.601 };

function three(): plan.PlanDocument {
  return [A, B, C].reduce((document, at, i) => plan.addPoint(document, at, 40 + 10 * i), plan.emptyPlan(A, 80));
}

describe('points', () => {
  it('are added in order, before a return that stands at the end', () => {
    const document = plan.addPoint(plan.addReturn(plan.addTakeoff(three(), 30)), B, 70);
    expect(plan.itemsOf(document).map(({ number, name, alt_m }) => [number, name, alt_m])).toEqual([
      [1, 'Take off', 30], [2, 'Waypoint', 40], [3, 'Waypoint', 50], [4, 'Waypoint', 60], [5, 'Waypoint', 70], [6, 'Return home', null],
    ]);
    const ids = document.mission.items.map((item) => item.doJumpId);
    expect(new Set(ids).size).toBe(6);
    expect(document.mission.items[1]!.params).toEqual([0, 0, 0, null, 58.5, 15.6, 40]);
  });

  it('are moved, inserted with the height between, and removed, and the document before stays as it was', () => {
    const before = three();
    const frozen = JSON.stringify(before);
    const leg = edgesOf(before).find((edge) => edge.kind === 'leg' && edge.index === 2)!;
    const { plan: after, handle } = insertedAt(before, leg, A);
    expect(plan.pointsOf(after).map((point) => point.alt_m)).toEqual([40, 50, 55, 60]);
    expect(handle).toEqual({ kind: 'item', index: 2 });
    expect(plan.pointsOf(moved(after, handle, C))[2]!.place).toEqual(C);
    expect(plan.pointsOf(removed(after, handle)).map((point) => point.alt_m)).toEqual([40, 50, 60]);
    expect(JSON.stringify(before)).toBe(frozen);
  });

  it('have a speed from there on, which goes with them', () => {
    let document = plan.setSpeed(three(), 1, 8);
    expect(plan.itemsOf(document).map((item) => item.command)).toEqual([16, 16, 178, 16]);
    expect(plan.listedOf(document).map((item) => item.speed_m_s)).toEqual([null, 8, null]);
    document = plan.setSpeed(document, 1, 6);
    expect(document.mission.items[2]!.params).toEqual([1, 6, -1, 0, 0, 0, 0]);
    expect(plan.setSpeed(document, 1, null).mission.items).toHaveLength(3);
    expect(plan.removeItem(document, 1).mission.items.map((item) => item.command)).toEqual([16, 16]);
  });

  it('keep what is not understood, and the height as it was typed', () => {
    const document = three();
    document.mission.items[0] = { ...document.mission.items[0]!, Altitude: 40, AltitudeMode: 1, AMSLAltAboveTerrain: 120, mine: 'x' };
    document.extra = { kept: true };
    const after = plan.setHold(plan.setHeight(document, 0, 45), 0, 12);
    expect(after.mission.items[0]).toMatchObject({ Altitude: 45, AMSLAltAboveTerrain: null, AltitudeMode: 1, mine: 'x', params: [12, 0, 0, null, 58.5, 15.6, 45] });
    expect(after.extra).toEqual({ kept: true });
  });

  it('are not removed while a jump leads to them', () => {
    const document = three();
    document.mission.items.push({ type: 'SimpleItem', command: 177, frame: 2, doJumpId: 9, params: [document.mission.items[1]!.doJumpId, 2, 0, 0, 0, 0, 0] });
    expect(() => plan.removeItem(document, 1)).toThrow(plan.PlanEditError);
    expect(plan.removeItem(document, 0).mission.items).toHaveLength(3);
  });

  it('are counted as the station does, surveys with what is in them', () => {
    const document = three();
    document.mission.items.splice(1, 0, { type: 'ComplexItem', complexItemType: 'survey', TransectStyleComplexItem: { Items: [{}, {}, {}] } });
    expect(plan.itemsOf(document).map((item) => item.number)).toEqual([1, 2, 5, 6]);
    expect(plan.itemsOf(document)[1]!.name).toBe('survey (3 items)');
  });

  it('without a place of their own, or that are only looked at, are not flown to', () => {
    const document = plan.addTakeoff(three(), 30);
    document.mission.items.push({ type: 'SimpleItem', command: 195, frame: 3, params: [0, 0, 0, 0, 58.6, 15.7, 0] });
    expect(plan.pointsOf(document).map((point) => point.index)).toEqual([1, 2, 3]);
  });
});

describe('fence, rally and home', () => {
  it('can be drawn, changed and taken away', () => {
    let document = plan.addCircle(plan.addPolygon(three(), true, [A, B, C]), false, B, 60);
    document = plan.addRally(document, C, 30);
    document = insertedAt(document, edgesOf(document).find((edge) => edge.kind === 'edge' && edge.corner === 3)!, A).plan;
    expect(plan.zonesOf(document)).toMatchObject([{ kind: 'polygon', inclusion: true, ring: [A, B, C, A] }, { kind: 'circle', radius_m: 60, ring: [B] }]);
    document = plan.setInclusion(plan.setRadius(document, 0, 90), 'circle', 0, true);
    document = moved(document, { kind: 'circle', index: 0 }, C);
    document = moved(document, { kind: 'rally', index: 0 }, A);
    document = plan.setRallyHeight(moved(document, { kind: 'home' }, B), 0, 55);
    expect(plan.zonesOf(document)[1]).toMatchObject({ inclusion: true, radius_m: 90, ring: [C] });
    expect(plan.rallyOf(document)).toEqual([{ ...A, alt_m: 55 }]);
    expect(document.mission.plannedHomePosition).toEqual([58.501, 15.602, 80]);
    document = removed(removed(document, { kind: 'polygon', index: 0, corner: 0 }), { kind: 'polygon', index: 0, corner: 0 });
    document = removed(removed(document, { kind: 'circle', index: 0 }), { kind: 'rally', index: 0 });
    expect(handlesOf(document).map(({ handle }) => handle.kind)).toEqual(['home', 'item', 'item', 'item']);
  });

  it('are made where a plan has no such part', () => {
    const bare = { fileType: 'Plan', version: 1, mission: { version: 2, items: [] } } as unknown as plan.PlanDocument;
    expect(plan.addCircle(bare, true, A, 50).geoFence).toMatchObject({ version: 2, polygons: [] });
    expect(plan.addRally(bare, A, 20).rallyPoints).toEqual({ version: 2, points: [[58.5, 15.6, 20]] });
    expect([plan.zonesOf(bare), plan.rallyOf(bare), plan.homeOf(bare)]).toEqual([[], [], null]);
  });
});

describe('undo', () => {
  it('goes back and forth, and a new edit ends what was ahead', () => {
    let history: History<number> = noted(noted(NO_HISTORY, 1), 2);
    const back = undone(history, 3)!;
    expect(back.now).toBe(2);
    expect(redone(back.history, 2)!.now).toBe(3);
    history = noted(back.history, 2);
    expect(redone(history, 4)).toBeNull();
    expect(undone(NO_HISTORY, 0)).toBeNull();
  });
});

describe('pixels from a leg', () => {
  it('are across it within its ends, and to the end beyond', () => {
    expect(pixelsFrom([5, 3], [0, 0], [10, 0])).toBe(3);
    expect(pixelsFrom([13, 4], [0, 0], [10, 0])).toBe(5);
    expect(pixelsFrom([3, 4], [0, 0], [0, 0])).toBe(5);
  });
});
