/** A WebSocket that comes back: back-off, visible state, and a watch on silence. */

import { backoffMs } from './backoff';
import type { ConnectionStatus, Feed } from './source';

export interface SocketHandlers {
  status(status: ConnectionStatus): void;
  opened?(): void;
  /** Throwing ends the connection, and the error's text is shown as the reason. */
  data(data: string | ArrayBuffer): void;
}

/** The surroundings, injected so that tests need neither a network nor a clock. */
export interface SocketWorld {
  connect(url: string): WebSocket;
  now(): number;
  random(): number;
  after(ms: number, run: () => void): () => void;
}

export const browserWorld: SocketWorld = {
  connect: (url) => new WebSocket(url),
  now: () => performance.now(),
  random: Math.random,
  after: (ms, run) => {
    const timer = setTimeout(run, ms);
    return () => clearTimeout(timer);
  },
};

export interface SocketOptions {
  /** Sent when nothing came for a third of `silence_ms`; null where the peer may be silent for long. */
  ping: string | null;
  silence_ms: number;
}

export class ReconnectingSocket implements Feed {
  private socket: WebSocket | null = null;
  private attempt = 0;
  private closed = false;
  private heardAt = 0;
  private cancelTimer: () => void = () => undefined;

  constructor(
    private readonly url: string,
    private readonly handlers: SocketHandlers,
    private readonly options: SocketOptions,
    private readonly world: SocketWorld = browserWorld,
  ) {
    this.connect('');
  }

  close(): void {
    if (this.closed) return;
    this.closed = true;
    this.cancelTimer();
    this.socket?.close();
    this.socket = null;
    this.report('closed', null, '');
  }

  private report(phase: ConnectionStatus['phase'], retry_in_ms: number | null, reason: string): void {
    this.handlers.status({ phase, attempt: this.attempt, retry_in_ms, reason });
  }

  private connect(reason: string): void {
    this.report('connecting', null, reason);
    const socket = this.world.connect(this.url);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.heardAt = this.world.now();
    let opened = false;
    socket.onopen = () => {
      if (this.socket !== socket) return;
      opened = true;
      this.heardAt = this.world.now();
      this.report('open', null, '');
      this.handlers.opened?.();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      if (this.socket !== socket) return;
      this.heardAt = this.world.now();
      // Only what was understood counts as success: a peer that talks nonsense is not retried in a tight loop.
      try {
        this.handlers.data(event.data);
        this.attempt = 0;
      } catch (error) {
        this.drop(socket, error instanceof Error ? error.message : String(error));
      }
    };
    socket.onclose = (event: CloseEvent) => {
      this.drop(socket, event.reason || (opened ? 'the station closed the connection' : 'the station does not answer'));
    };
    this.watch(socket);
  }

  private watch(socket: WebSocket): void {
    const { ping, silence_ms } = this.options;
    this.cancelTimer = this.world.after(silence_ms / 3, () => {
      if (this.socket !== socket) return;
      const silent_ms = this.world.now() - this.heardAt;
      if (silent_ms >= silence_ms && (ping !== null || socket.readyState !== WebSocket.OPEN)) {
        this.drop(socket, `nothing heard for ${Math.round(silent_ms / 1000)} s`);
        return;
      }
      if (ping !== null && socket.readyState === WebSocket.OPEN) socket.send(ping);
      this.watch(socket);
    });
  }

  private drop(socket: WebSocket, reason: string): void {
    if (this.socket !== socket || this.closed) return;
    this.socket = null;
    this.cancelTimer();
    socket.close();
    const wait_ms = backoffMs(this.attempt, this.world.random());
    this.attempt += 1;
    this.report('retrying', wait_ms, reason);
    this.cancelTimer = this.world.after(wait_ms, () => this.connect(reason));
  }
}
