import { describe, expect, it } from 'vitest';
import { Deletions } from './deletions';

function bench() {
  const timers = new Map<number, () => void>();
  let count = 0;
  const sent: string[] = [];
  let hidden: string[] = [];
  const deletions = new Deletions(
    8000,
    (id, urgently) => sent.push(urgently ? `${id}!` : id),
    (ids) => (hidden = [...ids]),
    {
      now_ms: () => 0,
      after: (_ms, run) => {
        const handle = count++;
        timers.set(handle, run);
        return () => timers.delete(handle);
      },
    },
  );
  const expire = () => [...timers].forEach(([handle, run]) => (timers.delete(handle), run()));
  return { deletions, sent, hidden: () => hidden, expire };
}

describe('Deletions', () => {
  it('hides at once and sends later', () => {
    const b = bench();
    b.deletions.start('a');
    b.deletions.start('a');
    expect([b.sent, b.hidden()]).toEqual([[], ['a']]);
    b.expire();
    expect([b.sent, b.hidden()]).toEqual([['a'], []]);
  });

  it('takes back the last one, then the one before', () => {
    const b = bench();
    b.deletions.start('a');
    b.deletions.start('b');
    expect(b.deletions.undo()).toBe('b');
    expect(b.hidden()).toEqual(['a']);
    expect(b.deletions.undo()).toBe('a');
    expect(b.deletions.undo()).toBeNull();
    b.expire();
    expect(b.sent).toEqual([]);
  });

  it('cannot take back what was sent', () => {
    const b = bench();
    b.deletions.start('a');
    b.expire();
    expect(b.deletions.undo('a')).toBeNull();
  });

  it('sends everything when the page goes', () => {
    const b = bench();
    b.deletions.start('a');
    b.deletions.start('b');
    b.deletions.flush();
    b.expire();
    expect(b.sent).toEqual(['a!', 'b!']);
  });
});
