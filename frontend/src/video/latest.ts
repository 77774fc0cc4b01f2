/** One request at a time, not too often, and of the questions that come meanwhile the latest. Pure but for its timers. */

export interface Timers {
  now_ms(): number;
  /** Later; returns a cancellation. */
  after(ms: number, run: () => void): () => void;
}

export const BROWSER_TIMERS: Timers = {
  now_ms: () => performance.now(),
  after: (ms, run) => {
    const handle = setTimeout(run, ms);
    return () => clearTimeout(handle);
  },
};

export class LatestOnly<Answer> {
  private waiting: (() => Promise<Answer> | null) | null = null;
  private busy = false;
  private sent_ms = -Infinity;
  private cancelTimer: (() => void) | null = null;
  /** Goes up when what is under way no longer matters. */
  private generation = 0;

  constructor(
    private readonly shortest_ms: number,
    private readonly settled: (answer: Answer | null, error: unknown) => void,
    private readonly timers: Timers = BROWSER_TIMERS,
  ) {}

  /** The question is put together when it is sent; null then means that it is no longer worth asking. */
  ask(question: () => Promise<Answer> | null): void {
    this.waiting = question;
    this.next();
  }

  /** Forget what waits, and the answer of what is under way. */
  cancel(): void {
    this.waiting = null;
    this.generation += 1;
    this.cancelTimer?.();
    this.cancelTimer = null;
  }

  private next(): void {
    if (this.busy || this.cancelTimer || !this.waiting) return;
    const wait_ms = this.sent_ms + this.shortest_ms - this.timers.now_ms();
    if (wait_ms > 0) {
      this.cancelTimer = this.timers.after(wait_ms, () => {
        this.cancelTimer = null;
        this.next();
      });
      return;
    }
    const question = this.waiting;
    this.waiting = null;
    const answer = question();
    if (!answer) return;
    this.busy = true;
    this.sent_ms = this.timers.now_ms();
    const { generation } = this;
    const done = (value: Answer | null, error: unknown) => {
      this.busy = false;
      if (generation === this.generation) this.settled(value, error);
      this.next();
    };
    answer.then(
      (value) => done(value, null),
      (error: unknown) => done(null, error),
    );
  }
}
