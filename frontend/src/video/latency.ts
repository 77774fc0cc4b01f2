/** Median and 95th percentile of the last few hundred values. Pure. */

export interface Quantiles {
  count: number;
  median: number | null;
  p95: number | null;
}

export class RecentQuantiles {
  private readonly values: number[] = [];
  private next = 0;
  private total = 0;

  constructor(private readonly capacity = 500) {}

  add(value: number): void {
    if (!Number.isFinite(value)) return;
    this.values[this.next] = value;
    this.next = (this.next + 1) % this.capacity;
    this.total += 1;
  }

  clear(): void {
    this.values.length = 0;
    this.next = 0;
    this.total = 0;
  }

  read(): Quantiles {
    if (this.values.length === 0) return { count: 0, median: null, p95: null };
    const sorted = [...this.values].sort((a, b) => a - b);
    const at = (q: number) => sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))]!;
    return { count: this.total, median: at(0.5), p95: at(0.95) };
  }
}
