import { describe, expect, it } from 'vitest';
import { LatestOnly } from './latest';

/** Requests that are answered by hand, and a clock that is moved by hand. */
function bench(shortest_ms: number) {
  let now = 0;
  let timer: { at: number; run: () => void } | null = null;
  const open: { name: string; resolve: (v: string) => void; reject: (e: unknown) => void }[] = [];
  const sent: string[] = [];
  const heard: (string | null)[] = [];
  const latest = new LatestOnly<string>(shortest_ms, (answer, error) => heard.push(error ? `refused: ${String(error)}` : answer), {
    now_ms: () => now,
    after: (ms, run) => {
      const mine = { at: now + ms, run };
      timer = mine;
      return () => {
        if (timer === mine) timer = null;
      };
    },
  });
  return {
    latest,
    sent,
    heard,
    ask: (name: string) =>
      latest.ask(() => {
        sent.push(name);
        return new Promise<string>((resolve, reject) => open.push({ name, resolve, reject }));
      }),
    answer: async (failure?: string) => {
      const first = open.shift()!;
      if (failure) first.reject(failure);
      else first.resolve(first.name);
      await Promise.resolve();
      await Promise.resolve();
    },
    pass: (ms: number) => {
      now += ms;
      if (timer && timer.at <= now) {
        const { run } = timer;
        timer = null;
        run();
      }
    },
    openCount: () => open.length,
  };
}

describe('LatestOnly', () => {
  it('has one request under way and skips all but the latest', async () => {
    const b = bench(0);
    for (const name of ['a', 'b', 'c', 'd']) b.ask(name);
    expect(b.sent).toEqual(['a']);
    await b.answer();
    expect(b.sent).toEqual(['a', 'd']);
    await b.answer();
    expect(b.heard).toEqual(['a', 'd']);
    expect(b.openCount()).toBe(0);
  });

  it('keeps a distance between requests', async () => {
    const b = bench(100);
    b.ask('a');
    await b.answer();
    b.pass(40);
    b.ask('b');
    b.ask('c');
    expect(b.sent).toEqual(['a']);
    b.pass(59);
    expect(b.sent).toEqual(['a']);
    b.pass(1);
    expect(b.sent).toEqual(['a', 'c']);
  });

  it('goes on after a refusal', async () => {
    const b = bench(0);
    b.ask('a');
    b.ask('b');
    await b.answer('sky');
    await b.answer();
    expect(b.heard).toEqual(['refused: sky', 'b']);
  });

  it('does not tell what was cancelled, and asks again afterwards', async () => {
    const b = bench(0);
    b.ask('a');
    b.ask('b');
    b.latest.cancel();
    b.ask('c');
    await b.answer();
    expect(b.heard).toEqual([]);
    await b.answer();
    expect(b.heard).toEqual(['c']);
  });

  it('lets a question be withdrawn when its turn comes', () => {
    const b = bench(0);
    b.latest.ask(() => null);
    b.ask('a');
    expect(b.sent).toEqual(['a']);
  });
});
