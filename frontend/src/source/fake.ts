/** A station in the page, for development without one. Development only: the production build does not contain it. */

import { NO_PLANS } from '../api/plans';
import type { NewTarget, StationApi } from '../api/client';
import type { FrameHeader, StationMessage, Target } from '../api/types';
import { offsetBy } from '../geo/earth';
import { mgrsFromGeodetic } from '../geo/utm';
import type { Feed, MessageListener, Source, VideoListener } from './source';

const HOME = { lat_deg: 58.4947, lon_deg: 15.1022 };
const ROUTE_RADIUS_M = 180;
const RATE_RAD_S = 0.06;

class FakeStation implements Source {
  private listener: MessageListener | null = null;
  private seq = 0;
  private ticks = 0;
  private targets: Target[] = [];
  private denied = false;
  private cut = false;
  private readonly start_ms = Date.now();

  say(message: object): void {
    const full = { seq: ++this.seq, t_unix_us: Date.now() * 1000, ...message } as StationMessage;
    void this.listener?.messages([full]);
  }

  openMessages(listener: MessageListener): Feed {
    this.listener = listener;
    listener.status({ phase: 'open', attempt: 0, retry_in_ms: null, reason: '' });
    this.say({
      type: 'hello',
      station: { name: 'fake', version: 'dev', data_dir_free_bytes: 5e10 },
      vehicles: [{ id: '1' }],
      maps: [],
      targets: { type: 'FeatureCollection', features: this.targets },
      alarms: [],
      recording: { active: false, flight_id: null },
      waiting_for: ['reference imagery (import a GeoTIFF)'],
    });
    const timer = setInterval(() => this.tick(), 100);
    return { close: () => clearInterval(timer) };
  }

  private tick(): void {
    this.ticks += 1;
    const t_s = (Date.now() - this.start_ms) / 1000;
    const phase = t_s * RATE_RAD_S;
    const at = offsetBy(HOME, ROUTE_RADIUS_M * Math.sin(phase), ROUTE_RADIUS_M * Math.cos(phase));
    const heading_deg = ((((-phase * 180) / Math.PI) % 360) + 360) % 360;
    const wander = offsetBy(at, 2 * Math.sin(t_s / 5), 2 * Math.cos(t_s / 7));
    const corner = (n: number, e: number): [number, number] => {
      const p = offsetBy(at, n, e);
      return [p.lat_deg, p.lon_deg];
    };
    this.say({
      type: 'state',
      vehicle_id: '1',
      epoch: 0,
      mode: this.denied || this.cut ? 'vision' : 'gps',
      process_model: 'inertial',
      ...wander,
      alt_amsl_m: 210,
      alt_agl_m: 118,
      std_n_m: 0.8,
      std_e_m: 1.1,
      std_d_m: 1.5,
      cov_ne_m2: 0.1,
      ellipse95: { semi_major_m: 2.8, semi_minor_m: 1.9, azimuth_deg: 70 },
      vn_m_s: 1,
      ve_m_s: 1,
      vd_m_s: -0.2,
      ground_speed_m_s: ROUTE_RADIUS_M * RATE_RAD_S,
      roll_deg: 6 * Math.sin(t_s),
      pitch_deg: 4 * Math.cos(t_s / 2),
      heading_deg,
      last_fix_age_s: t_s % 1.2,
      gps_denied: this.denied,
      video_clock: t_s < 6
        ? { source: 'searching', time_offset_s: null, std_s: null, reason: 'too few pairs of pictures' }
        : { source: 'found', time_offset_s: -0.121, std_s: 0.004, reason: '' },
      boresight_deg: [0.3, -0.2, 0.1],
      boresight_std_deg: t_s < 6 ? [0.57, 0.57, 0.57] : [0.1, 0.1, 0.5],
      footprint: [corner(50, -66), corner(50, 66), corner(-50, 66), corner(-50, -66)],
    });
    if (this.ticks % 2 === 0) {
      this.say({ type: 'gps', vehicle_id: '1', ...at, alt_amsl_m: 210, fix_type: this.cut ? 0 : 3, satellites: 14, std_horizontal_m: 1, used: !this.denied });
    }
    if (this.ticks % 10 === 0) {
      this.say({ type: 'telemetry', vehicle_id: '1', vehicle_type: 'helicopter', simulated: true, armed: true, flight_mode: 'AUTO', battery_pct: 81, battery_v: 22.4, battery_a: 14, battery_age_s: 0.3, airspeed_m_s: 11, airspeed_age_s: 0.1, alt_rel_m: 118, alt_rel_age_s: 0.1, wind_speed_m_s: 4, wind_from_deg: 250, wind_age_s: 0.5 });
      this.say({ type: 'link', vehicle_id: '1', connected: true, heartbeat_age_s: 0.4, messages_per_s: 141, bytes_per_s: 7400, loss_pct: 0, noise_bytes: 0, signed: false, endpoint: 'fake' });
      this.say({ type: 'video', source: 'cam-1', vehicle_id: '1', status: 'flowing', fps: 25, width: 640, height: 480, codec: 'jpeg', last_frame_age_s: 0.02, latency_ms: 4, decode_errors: 0, epoch: 1 });
    }
  }

  openVideo(_source: string, _codec: string, listener: VideoListener): Feed {
    const canvas = document.createElement('canvas');
    canvas.width = 640;
    canvas.height = 480;
    const context = canvas.getContext('2d')!;
    let frame_id = 0;
    listener.status({ phase: 'open', attempt: 0, retry_in_ms: null, reason: '' });
    const timer = setInterval(() => {
      const id = frame_id++;
      for (let x = 0; x < 640; x += 40) {
        for (let y = -40; y < 480; y += 40) {
          context.fillStyle = (x / 40 + y / 40) % 2 === 0 ? '#3d4a33' : '#56624a';
          context.fillRect(x, y + (id % 40), 40, 40);
        }
      }
      const t_wire_unix_us = Date.now() * 1000;
      canvas.toBlob(
        (blob) => {
          void blob?.arrayBuffer().then((bytes) => {
            const header: FrameHeader = {
              frame_id: id,
              epoch: 1,
              t_unix_us: t_wire_unix_us,
              t_wire_unix_us,
              codec: 'jpeg',
              codec_string: 'jpeg',
              key: true,
              width: 640,
              height: 480,
              latency_ms: 0,
            };
            listener.picture({ header, payload: new Uint8Array(bytes) });
          });
        },
        'image/jpeg',
        0.7,
      );
    }, 40);
    return { close: () => clearInterval(timer) };
  }

  readonly api: StationApi = {
    createTarget: (wanted: NewTarget) => {
      const at = 'lat_deg' in wanted ? wanted : HOME;
      const now_us = Date.now() * 1000;
      const target = {
        type: 'Feature',
        id: crypto.randomUUID(),
        geometry: { type: 'Point', coordinates: [at.lon_deg, at.lat_deg, 92] },
        properties: {
          name: `T${this.targets.length + 1}`,
          mgrs: mgrsFromGeodetic(at),
          lat_deg: at.lat_deg,
          lon_deg: at.lon_deg,
          alt_amsl_m: 92,
          method: 'frame_id' in wanted ? 'ray_terrain' : 'manual',
          ce90_m: 3.1,
          ellipse95: { semi_major_m: 4, semi_minor_m: 2.5, azimuth_deg: 30 },
          created_unix_us: now_us,
          updated_unix_us: now_us,
          version: 1,
        },
      } as unknown as Target;
      this.targets.push(target);
      this.say({ type: 'target', action: 'created', target });
      return Promise.resolve(target);
    },
    renameTarget: (target, name) =>
      Promise.resolve({ ...target, properties: { ...target.properties, name, version: target.properties.version + 1 } }),
    deleteTarget: () => Promise.resolve(),
    locate: (_id, pixel, pointing) =>
      Promise.resolve({
        ...pixel,
        ...pointing,
        ...HOME,
        t_unix_us: Date.now() * 1000,
        mgrs: mgrsFromGeodetic(HOME),
        utm: null,
        dms: '',
        alt_amsl_m: 92,
        method: 'ray_terrain',
        std_n_m: 1,
        std_e_m: 1,
        std_d_m: 1,
        cov_ne_m2: 0,
        ce90_m: 2.1,
        ellipse95: { semi_major_m: 2.4, semi_minor_m: 2.4, azimuth_deg: 0 },
        ellipse95_px: null,
      }),
    footprint: () => Promise.reject(new Error('the fake station knows no ground')),
    align: () => Promise.resolve(),
    trackPoint: () => Promise.resolve(),
    followTarget: (target) => Promise.resolve(target),
    targetTrack: () => Promise.resolve({ type: 'FeatureCollection', features: [] }),
    pictureUrl: () => '',
    exportUrl: () => '',
    denyGps: (_id, denied) => {
      this.denied = denied;
      return Promise.resolve();
    },
    checkAiding: () => Promise.reject(new Error('no autopilot is told anything here')),
    aid: () => Promise.reject(new Error('no autopilot is told anything here')),
    injectGpsFailure: (_id, failure) => {
      this.cut = failure === 'off';
      return Promise.resolve('1');
    },
    plans: NO_PLANS,
    command: () => Promise.reject(new Error('the fake station flies nothing')),
    track: () => Promise.resolve({ type: 'FeatureCollection', features: [] }),
    history: () => Promise.reject(new Error('the fake station remembers nothing')),
    flights: () => Promise.resolve([]),
    reportUrl: () => '',
    deleteFlight: () => Promise.resolve(),
    record: () => Promise.resolve(),
    startReplay: (id) => Promise.resolve(`replay-${id}`),
    changeReplay: () => Promise.resolve(),
    leaveReplay: () => Promise.resolve(),
    importMap: () => Promise.reject(new Error('the fake station takes no maps')),
    deleteMap: () => Promise.resolve(),
    tileUrl: () => '',
    matchability: () => Promise.reject(new Error('nothing is computed here')),
    matchabilityTileUrl: () => '',
    pad: () => Promise.resolve(null),
    givePad: () => Promise.reject(new Error('nothing is landed here')),
    removePad: () => Promise.resolve(),
    askLanding: () => Promise.reject(new Error('nothing is landed here')),
    askHoming: () => Promise.reject(new Error('nothing is flown here')),
    padView: () => Promise.resolve(null),
  };
}

export function fakeStation(): { source: Source; api: StationApi } {
  const station = new FakeStation();
  return { source: station, api: station.api };
}
