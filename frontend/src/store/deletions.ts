/** Deletions that wait a while before they are sent, so that they can be taken back. Pure but for its timers. */

import type { Timers } from '../video/latest';

export class Deletions {
  private readonly waiting = new Map<string, () => void>();

  /** `changed` hears which targets are hidden, `send` deletes one at the station; `urgently` when the page goes away. */
  constructor(
    private readonly wait_ms: number,
    private readonly send: (id: string, urgently: boolean) => void,
    private readonly changed: (hidden: ReadonlySet<string>) => void,
    private readonly timers: Timers,
  ) {}

  start(id: string): void {
    if (this.waiting.has(id)) return;
    this.waiting.set(id, this.timers.after(this.wait_ms, () => this.finish(id, false)));
    this.tell();
  }

  /** Takes back a deletion, by default the last one; null when there is none left to take back. */
  undo(id: string | undefined = [...this.waiting.keys()].pop()): string | null {
    const cancel = id === undefined ? undefined : this.waiting.get(id);
    if (id === undefined || !cancel) return null;
    cancel();
    this.waiting.delete(id);
    this.tell();
    return id;
  }

  /** Somebody else deleted it meanwhile. */
  forget(id: string): void {
    this.undo(id);
  }

  /** The page goes away: what was deleted is deleted. */
  flush(): void {
    for (const [id, cancel] of [...this.waiting]) {
      cancel();
      this.finish(id, true);
    }
  }

  private finish(id: string, urgently: boolean): void {
    this.waiting.delete(id);
    this.send(id, urgently);
    this.tell();
  }

  private tell(): void {
    this.changed(new Set(this.waiting.keys()));
  }
}
