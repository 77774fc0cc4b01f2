/** Rows of numbers over time in typed arrays: the newest are kept, memory is taken once. Pure. */

export type Row = Record<string, number | null | undefined>;

export interface Curves {
  t_us: number[];
  /** One for each name asked for, as long as `t_us`; null where nothing is known. */
  values: (number | null)[][];
}

export interface ColumnsOptions {
  capacity: number;
  /** A row that comes sooner after the last one is left out. */
  step_us?: number;
  /** Columns that a float of 32 bits is too coarse for. */
  fine?: readonly string[];
}

export class Columns {
  private readonly capacity: number;
  private readonly step_us: number;
  private readonly times: Float64Array;
  private readonly columns = new Map<string, Float64Array | Float32Array>();
  private first = 0;
  private count = 0;
  /** Goes up with every row. */
  revision = 0;

  constructor(
    readonly names: readonly string[],
    { capacity, step_us = 1, fine = [] }: ColumnsOptions,
  ) {
    this.capacity = capacity;
    this.step_us = step_us;
    this.times = new Float64Array(capacity);
    for (const name of names) {
      this.columns.set(name, fine.includes(name) ? new Float64Array(capacity) : new Float32Array(capacity));
    }
  }

  get length(): number {
    return this.count;
  }

  get first_us(): number | null {
    return this.count > 0 ? this.time(0) : null;
  }

  get last_us(): number | null {
    return this.count > 0 ? this.time(this.count - 1) : null;
  }

  get bytes(): number {
    let bytes = this.times.byteLength;
    for (const column of this.columns.values()) bytes += column.byteLength;
    return bytes;
  }

  clear(): void {
    this.first = this.count = 0;
    this.revision += 1;
  }

  /** Unless it comes too soon after, or before, the last one. */
  push(t_us: number, row: Row): boolean {
    const { last_us } = this;
    if (last_us !== null && t_us - last_us < this.step_us) return false;
    const at = (this.first + this.count) % this.capacity;
    this.times[at] = t_us;
    for (const [name, column] of this.columns) column[at] = row[name] ?? NaN;
    if (this.count < this.capacity) this.count += 1;
    else this.first = (this.first + 1) % this.capacity;
    this.revision += 1;
    return true;
  }

  /** Adds rows of another memory wherever no own row is as near as `apart_us`: before the first, and in holes. */
  fill(other: Columns, apart_us: number): void {
    const own = new Columns(this.names, { capacity: Math.max(1, this.count), fine: this.fineNames() });
    for (let i = 0; i < this.count; i++) own.copy(this, i);
    this.clear();
    let next = 0;
    for (let i = 0; i < other.count; i++) {
      const t_us = other.time(i);
      while (next < own.count && own.time(next) <= t_us) this.copy(own, next++);
      if (own.nearest(t_us, apart_us) < 0) this.copy(other, i);
    }
    while (next < own.count) this.copy(own, next++);
  }

  /** Rewrites a column by the times of its rows. */
  map(name: string, value: (t_us: number) => number): void {
    const column = this.columns.get(name)!;
    for (let i = 0; i < this.count; i++) column[(this.first + i) % this.capacity] = value(this.time(i));
    this.revision += 1;
  }

  time(index: number): number {
    return this.times[(this.first + index) % this.capacity]!;
  }

  /** NaN where it is not known. */
  value(name: string, index: number): number {
    return this.columns.get(name)![(this.first + index) % this.capacity]!;
  }

  /** The first row after a time; `length` when there is none. */
  indexAfter(t_us: number): number {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) <= t_us) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The row nearest to a time, -1 when none is within `within_us`. */
  nearest(t_us: number, within_us: number): number {
    const after = this.indexAfter(t_us);
    const gap = (index: number) => (index >= 0 && index < this.count ? Math.abs(this.time(index) - t_us) : Infinity);
    const best = gap(after - 1) <= gap(after) ? after - 1 : after;
    return gap(best) <= within_us ? best : -1;
  }

  /** A value at a time by the rows before and after; NaN outside them and in gaps of more than `gap_us`. */
  between(name: string, t_us: number, gap_us: number): number {
    const after = this.indexAfter(t_us);
    if (after === 0) return NaN;
    const before = after - 1;
    if (this.time(before) === t_us) return this.value(name, before);
    if (after >= this.count || this.time(after) - this.time(before) > gap_us) return NaN;
    const part = (t_us - this.time(before)) / (this.time(after) - this.time(before));
    return this.value(name, before) + part * (this.value(name, after) - this.value(name, before));
  }

  /**
   * Curves to draw from `from_us` to `to_us`: all rows where they are few, else of each of `buckets` equal parts the
   * least and the greatest value, in the order they came in, so that no spike is lost.
   */
  curves(names: readonly string[], from_us: number, to_us: number, buckets: number): Curves {
    const begin = Math.max(0, this.indexAfter(from_us - 1) - 1);
    const end = Math.min(this.count, this.indexAfter(to_us) + 1);
    const t_us: number[] = [];
    const values: (number | null)[][] = names.map(() => []);
    if (end - begin <= 2 * buckets) {
      for (let i = begin; i < end; i++) {
        t_us.push(this.time(i));
        names.forEach((name, k) => values[k]!.push(known(this.value(name, i))));
      }
      return { t_us, values };
    }
    const width_us = (to_us - from_us) / buckets;
    for (let i = begin; i < end; ) {
      // By whole parts since 1970, so that a window that moves on does not make the curve flicker.
      const part = Math.floor(this.time(i) / width_us);
      let next = i;
      while (next < end && Math.floor(this.time(next) / width_us) === part) next++;
      t_us.push(this.time(i), next - i > 1 ? this.time(next - 1) : this.time(i) + 1);
      names.forEach((name, k) => values[k]!.push(...this.extremes(name, i, next)));
      i = next;
    }
    return { t_us, values };
  }

  private extremes(name: string, begin: number, end: number): [number | null, number | null] {
    let least = -1;
    let greatest = -1;
    for (let i = begin; i < end; i++) {
      const value = this.value(name, i);
      if (Number.isNaN(value)) continue;
      if (least < 0 || value < this.value(name, least)) least = i;
      if (greatest < 0 || value > this.value(name, greatest)) greatest = i;
    }
    if (least < 0) return [null, null];
    const ends: [number, number] = [this.value(name, Math.min(least, greatest)), this.value(name, Math.max(least, greatest))];
    return ends;
  }

  private copy(other: Columns, index: number): void {
    const row: Row = {};
    for (const name of this.names) row[name] = other.value(name, index);
    this.push(other.time(index), row);
  }

  private fineNames(): string[] {
    return this.names.filter((name) => this.columns.get(name) instanceof Float64Array);
  }
}

function known(value: number): number | null {
  return Number.isNaN(value) ? null : value;
}
