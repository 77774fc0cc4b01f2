import { beforeEach, describe, expect, it } from 'vitest';
import { ReconnectingSocket, type SocketWorld } from './socket';
import type { ConnectionStatus } from './source';

class FakeSocket {
  static readonly OPEN = 1;
  readyState = 0;
  binaryType = '';
  sent: string[] = [];
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { reason: string }) => void) | null = null;
  send(text: string) {
    this.sent.push(text);
  }
  close() {
    this.readyState = 3;
  }
  open() {
    this.readyState = 1;
    this.onopen?.();
  }
}

class FakeWorld {
  sockets: FakeSocket[] = [];
  time = 0;
  timers: { at: number; run: () => void }[] = [];
  connect = () => {
    const socket = new FakeSocket();
    this.sockets.push(socket);
    return socket as unknown as WebSocket;
  };
  now = () => this.time;
  random = () => 0;
  after = (ms: number, run: () => void) => {
    const timer = { at: this.time + ms, run };
    this.timers.push(timer);
    return () => {
      this.timers = this.timers.filter((other) => other !== timer);
    };
  };
  advance(ms: number) {
    const end = this.time + ms;
    for (;;) {
      const next = this.timers.filter((t) => t.at <= end).sort((a, b) => a.at - b.at)[0];
      if (!next) break;
      this.timers = this.timers.filter((t) => t !== next);
      this.time = next.at;
      next.run();
    }
    this.time = end;
  }
  get last() {
    return this.sockets[this.sockets.length - 1]!;
  }
}

let world: FakeWorld;
let statuses: ConnectionStatus[];
let received: unknown[];

function open(silence_ms = 9000, ping: string | null = 'ping') {
  return new ReconnectingSocket(
    'ws://station',
    {
      status: (s) => statuses.push(s),
      data: (d) => {
        if (d === 'bad') throw new Error('a bad message');
        received.push(d);
      },
    },
    { ping, silence_ms },
    world as unknown as SocketWorld,
  );
}

beforeEach(() => {
  globalThis.WebSocket ??= FakeSocket as unknown as typeof WebSocket;
  world = new FakeWorld();
  statuses = [];
  received = [];
});

describe('ReconnectingSocket', () => {
  it('delivers, and says that it is open', () => {
    open();
    world.last.open();
    world.last.onmessage?.({ data: 'hello' });
    expect(received).toEqual(['hello']);
    expect(statuses.map((s) => s.phase)).toEqual(['connecting', 'open']);
  });

  it('waits longer after each failure and starts again after success', () => {
    open();
    world.last.onclose?.({ reason: '' });
    expect(statuses.at(-1)).toEqual({ phase: 'retrying', attempt: 1, retry_in_ms: 400, reason: 'the station does not answer' });
    world.advance(400);
    expect(world.sockets).toHaveLength(2);
    world.last.onclose?.({ reason: '' });
    expect(statuses.at(-1)?.retry_in_ms).toBe(800);
    world.advance(800);
    world.last.open();
    world.last.onmessage?.({ data: 'x' });
    world.last.onclose?.({ reason: 'going down' });
    expect(statuses.at(-1)).toMatchObject({ retry_in_ms: 400, reason: 'going down' });
  });

  it('gives up a connection that fell silent, after asking', () => {
    open();
    world.last.open();
    const first = world.last;
    world.advance(8999);
    expect(first.sent.length).toBeGreaterThanOrEqual(2);
    world.advance(1);
    expect(statuses.at(-1)?.phase).toBe('retrying');
    expect(statuses.at(-1)?.reason).toContain('9 s');
  });

  it('lets a video socket be silent', () => {
    open(9000, null);
    world.last.open();
    world.advance(60_000);
    expect(world.sockets).toHaveLength(1);
    expect(world.last.sent).toEqual([]);
  });

  it('ends a connection that sends nonsense and backs off from it', () => {
    open();
    world.last.open();
    world.last.onmessage?.({ data: 'bad' });
    expect(statuses.at(-1)).toMatchObject({ phase: 'retrying', reason: 'a bad message', retry_in_ms: 400 });
    world.advance(400);
    world.last.open();
    world.last.onmessage?.({ data: 'bad' });
    expect(statuses.at(-1)?.retry_in_ms).toBe(800);
  });

  it('stays closed, and hears nothing of an old socket', () => {
    const socket = open();
    const first = world.last;
    first.open();
    socket.close();
    first.onmessage?.({ data: 'late' });
    first.onclose?.({ reason: '' });
    world.advance(60_000);
    expect(received).toEqual([]);
    expect(world.sockets).toHaveLength(1);
    expect(statuses.at(-1)?.phase).toBe('closed');
  });
});
