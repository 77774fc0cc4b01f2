/** The station itself. Replays run in the station and come over the same sockets as vehicles of their own. */

import type { StationMessage } from '../api/types';
import { WaitingMessages } from './coalesce';
import { ReconnectingSocket } from './socket';
import type { Feed, MessageListener, Source, VideoCodec, VideoListener } from './source';
import { parsePicture } from './wire';

const PING = JSON.stringify({ type: 'ping' });

export function socketUrl(page: string, path: string): string {
  const url = new URL(path, page);
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
  return url.toString();
}

/** Hands batches to a listener, one at a time. */
export class Pump {
  private readonly waiting = new WaitingMessages();
  private busy = false;

  constructor(private readonly listener: Pick<MessageListener, 'messages'>) {}

  put(message: StationMessage): void {
    this.waiting.put(message);
    if (!this.busy) void this.run();
  }

  private async run(): Promise<void> {
    this.busy = true;
    try {
      while (this.waiting.size > 0) await this.listener.messages(this.waiting.take());
    } finally {
      this.busy = false;
    }
  }
}

export class LiveSource implements Source {
  /** Under `name` the station knows this page: what it begins ends with it. */
  constructor(
    private readonly page: string,
    private readonly name: string,
  ) {}

  openMessages(listener: MessageListener): Feed {
    const pump = new Pump(listener);
    return new ReconnectingSocket(
      socketUrl(this.page, `api/v1/stream?page=${encodeURIComponent(this.name)}`),
      {
        status: (status) => listener.status(status),
        data: (data) => {
          if (typeof data === 'string') pump.put(JSON.parse(data) as StationMessage);
        },
      },
      { ping: PING, silence_ms: 9000 },
    );
  }

  openVideo(source: string, codec: VideoCodec, listener: VideoListener): Feed {
    return new ReconnectingSocket(
      socketUrl(this.page, `api/v1/video/${encodeURIComponent(source)}?codec=${codec}`),
      {
        status: (status) => listener.status(status),
        data: (data) => {
          if (typeof data !== 'string') listener.picture(parsePicture(data));
        },
      },
      { ping: null, silence_ms: 9000 },
    );
  }
}
