import { describe, expect, it } from 'vitest';
import { Columns } from './columns';

function filled(rows: number, capacity = rows, step_us = 1): Columns {
  const columns = new Columns(['a', 'b'], { capacity, step_us, fine: ['b'] });
  for (let i = 0; i < rows; i++) columns.push(i * 1000, { a: Math.sin(i), b: i });
  return columns;
}

describe('Columns', () => {
  it('keeps the newest rows, in order, in memory taken once', () => {
    const columns = filled(100, 100);
    const { bytes } = columns;
    for (let i = 100; i < 1000; i++) columns.push(i * 1000, { a: i, b: i });
    expect(columns.length).toBe(100);
    expect(columns.bytes).toBe(bytes);
    expect([columns.first_us, columns.last_us]).toEqual([900_000, 999_000]);
    expect(columns.value('b', 0)).toBe(900);
  });

  it('leaves out what comes too soon or backwards', () => {
    const columns = filled(0, 10, 95_000);
    expect(columns.push(0, { a: 1 })).toBe(true);
    expect(columns.push(90_000, { a: 2 })).toBe(false);
    expect(columns.push(100_000, { a: 3 })).toBe(true);
    expect(columns.push(50_000, { a: 4 })).toBe(false);
    expect(columns.length).toBe(2);
  });

  it('finds rows by time, and values between them', () => {
    const columns = filled(10);
    expect(columns.indexAfter(-1)).toBe(0);
    expect(columns.indexAfter(3000)).toBe(4);
    expect(columns.indexAfter(1e9)).toBe(10);
    expect(columns.nearest(3400, 500)).toBe(3);
    expect(columns.nearest(90_000, 500)).toBe(-1);
    expect(columns.between('b', 3250, 2000)).toBeCloseTo(3.25, 9);
    expect(columns.between('b', 9000, 2000)).toBe(9);
    expect(columns.between('b', 9001, 2000)).toBeNaN();
    expect(columns.between('b', -1, 2000)).toBeNaN();
  });

  it('does not draw a line through a gap', () => {
    const columns = new Columns(['b'], { capacity: 4 });
    columns.push(0, { b: 0 });
    columns.push(10e6, { b: 10 });
    expect(columns.between('b', 5e6, 1e6)).toBeNaN();
  });

  it('keeps a spike of one row among thirty thousand, when it is thinned', () => {
    const columns = new Columns(['a'], { capacity: 36_000 });
    for (let i = 0; i < 36_000; i++) columns.push(i * 100_000, { a: i === 12_345 ? 50 : i === 12_346 ? -50 : Math.sin(i / 50) });
    const { t_us, values } = columns.curves(['a'], 0, 3.6e9, 400);
    expect(t_us.length).toBeLessThanOrEqual(2 * 402);
    expect(Math.max(...(values[0] as number[]))).toBe(50);
    expect(Math.min(...(values[0] as number[]))).toBe(-50);
    expect(t_us.every((t, i) => i === 0 || t > t_us[i - 1]!)).toBe(true);
  });

  it('tells all rows where they are few, with holes as nulls', () => {
    const columns = new Columns(['a', 'b'], { capacity: 8 });
    columns.push(0, { a: 1, b: null });
    columns.push(1, { a: undefined, b: 2 });
    expect(columns.curves(['a', 'b'], 0, 10, 100)).toEqual({ t_us: [0, 1], values: [[1, null], [null, 2]] });
  });

  it('takes one row before and one after, so that lines reach the edges', () => {
    expect(filled(10).curves(['b'], 3500, 5500, 100).t_us).toEqual([3000, 4000, 5000, 6000]);
  });

  it('fills holes and what was before from another memory', () => {
    const heard = new Columns(['b'], { capacity: 6 });
    heard.push(50, { b: 5 });
    heard.push(60, { b: 6 });
    const older = new Columns(['b'], { capacity: 10 });
    for (let i = 1; i <= 7; i++) older.push(i * 10, { b: -i });
    heard.fill(older, 5);
    expect(heard.curves(['b'], 0, 100, 100)).toEqual({ t_us: [20, 30, 40, 50, 60, 70], values: [[-2, -3, -4, 5, 6, -7]] });
    const holes = new Columns(['b'], { capacity: 10 });
    holes.push(10, { b: 1 });
    holes.push(52, { b: 5 });
    holes.fill(older, 5);
    expect(holes.curves(['b'], 0, 100, 100).t_us).toEqual([10, 20, 30, 40, 52, 60, 70]);
  });
});
