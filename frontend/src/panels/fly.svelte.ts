/** What the operator commands: the place that is meant, and what became of the last commands. */

import type { StationApi } from '../api/client';
import type { Command, StationMessage } from '../api/types';
import type { LatLon } from '../geo/earth';
import { acknowledged, asked, commandName, heard, refused, sent, type CommandLog } from '../store/commands';

export class Fly {
  log = $state.raw<CommandLog>([]);
  /** Whether the next click on the map says where to go. */
  picking = $state(false);
  /** Where "go to" and "orbit" lead. */
  place = $state.raw<LatLon | null>(null);
  /** Metres above home; null until somebody has said. */
  alt_rel_m = $state<number | null>(null);
  takeoff_m = $state<number | null>(null);
  radius_m = $state<number | null>(50);
  clockwise = $state(true);
  private count = 0;

  constructor(private readonly api: StationApi) {}

  take(message: StationMessage): void {
    if (message.type === 'ack') this.log = acknowledged(this.log, message, Date.now());
    if (message.type === 'alarm' && message.code === 'vehicle_text' && message.severity !== 'info' && message.vehicle_id !== null) {
      this.log = heard(this.log, message.vehicle_id, message.text, Date.now());
    }
  }

  async command(vehicle_id: string, command: Command, detail = ''): Promise<void> {
    await this.ask(vehicle_id, `${commandName(command.command)}${detail}`, () => this.api.command(vehicle_id, command));
  }

  /** Something whose acknowledgements come on the stream; gives its id, null where it was refused at once. */
  async ask(vehicle_id: string, words: string, begin: () => Promise<string>): Promise<string | null> {
    const key = `here-${++this.count}`;
    this.log = asked(this.log, key, vehicle_id, words, Date.now());
    try {
      const command_id = await begin();
      this.log = sent(this.log, key, command_id);
      return command_id;
    } catch (error) {
      this.log = refused(this.log, key, error instanceof Error ? error.message : String(error), Date.now());
      return null;
    }
  }

  pick(at: LatLon): void {
    this.place = at;
    this.picking = false;
  }

  /** Another vehicle is flown now. */
  clear(): void {
    this.picking = false;
    this.place = null;
  }
}
