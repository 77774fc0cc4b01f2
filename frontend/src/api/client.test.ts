import { describe, expect, it } from 'vitest';
import { ApiError, problemError, RestApi } from './client';
import type { Target } from './types';

function station(status: number, body: unknown) {
  const calls: Request[] = [];
  const send = (request: Request) => {
    calls.push(request);
    return Promise.resolve(new Response(body === undefined ? null : JSON.stringify(body), { status }));
  };
  return { calls, api: new RestApi('http://station:8700/', send) };
}

const target = { id: 'a/b', properties: { version: 4 } } as unknown as Target;

describe('RestApi', () => {
  it('asks for what ends with this page under its name', async () => {
    const calls: Request[] = [];
    const send = (request: Request) => {
      calls.push(request);
      return Promise.resolve(new Response('{}', { status: 200 }));
    };
    await new RestApi('http://station:8700/', send, 'page-7').askLanding('1', { aiding: true });
    expect(calls[0]?.url).toBe('http://station:8700/api/v1/vehicles/1/landing');
    expect(await calls[0]?.json()).toEqual({ aiding: true, page: 'page-7' });
  });

  it('takes no pad, and no picture of it, for an answer', async () => {
    const { api } = station(404, { title: 'Not Found', detail: 'no landing pad is described' });
    expect(await api.pad()).toBeNull();
    expect(await station(204, undefined).api.padView('1')).toBeNull();
    await expect(api.padView('1')).rejects.toThrow('no landing pad');
    await expect(station(409, { title: 'Conflict' }).api.pad()).rejects.toThrow('Conflict');
  });

  it('reads off a picture of the pad what it is of', async () => {
    const headers = { 'X-Frame-Id': '77', 'X-Side-M': '2.86' };
    const api = new RestApi('http://station:8700/', () => Promise.resolve(new Response(new Blob(['jpeg']), { headers })));
    expect(await api.padView('1')).toMatchObject({ frame_id: 77, side_m: 2.86, picture: { size: 4 } });
  });

  it('sends a click with the number of its picture', async () => {
    const { api, calls } = station(201, { id: 't' });
    await api.createTarget({ vehicle_id: '1', frame_id: 812, u_px: 10.5, v_px: 20 });
    expect(calls[0]?.url).toBe('http://station:8700/api/v1/targets');
    expect(await calls[0]?.json()).toEqual({ vehicle_id: '1', frame_id: 812, u_px: 10.5, v_px: 20 });
  });

  it('names the version that a change is based on, and escapes ids', async () => {
    const { api, calls } = station(200, {});
    await api.renameTarget(target, 'Barn');
    expect(calls[0]?.url).toBe('http://station:8700/api/v1/targets/a%2Fb');
    expect(calls[0]?.headers.get('if-match')).toBe('"4"');
  });

  it('renames a followed target whatever its version is by then, and ends following', async () => {
    const { api, calls } = station(200, {});
    const followed = { id: 't', properties: { version: 4, track: { status: 'lost' } } } as unknown as Target;
    await api.renameTarget(followed, 'Van');
    await api.followTarget(followed, false);
    expect(calls.map((call) => call.headers.get('if-match'))).toEqual([null, null]);
    expect(await calls[1]?.json()).toEqual({ track: false });
  });

  it('asks where a pixel lies, at the chosen height', async () => {
    const { api, calls } = station(200, {});
    await api.locate('1', { frame_id: 5, u_px: 1, v_px: 2 }, { height_above_ground_m: 3, ground: 'flat' });
    expect(calls[0]?.url).toBe('http://station:8700/api/v1/vehicles/1/locate');
    expect(await calls[0]?.json()).toEqual({ frame_id: 5, u_px: 1, v_px: 2, height_above_ground_m: 3, ground: 'flat' });
    await api.footprint('replay-a', 7, { height_above_ground_m: 0, ground: 'terrain' });
    expect(calls[1]?.url).toBe(
      'http://station:8700/api/v1/vehicles/replay-a/frames/7/footprint?height_above_ground_m=0&ground=terrain',
    );
  });

  it('tells a camera what to follow, and to stop', async () => {
    const { api, calls } = station(202, { command_id: 'x' });
    await api.trackPoint('1', { frame_id: 5, u_px: 1, v_px: 2 });
    await api.trackPoint('1', null);
    expect(await calls[0]?.json()).toEqual({ command: 'track_point', frame_id: 5, u_px: 1, v_px: 2 });
    expect(await calls[1]?.json()).toEqual({ command: 'track_stop' });
  });

  it('has addresses for pictures and files', () => {
    const { api } = station(200, {});
    expect(api.pictureUrl(target, 64)).toBe('http://station:8700/api/v1/targets/a%2Fb/picture?size_px=64');
    expect(api.exportUrl('kml')).toBe('http://station:8700/api/v1/targets?format=kml');
  });

  it('accepts an empty answer', async () => {
    await expect(station(204, undefined).api.deleteTarget(target)).resolves.toBeUndefined();
  });

  it('turns a problem document into words', async () => {
    const { api } = station(422, { title: 'No ground there', detail: 'the ray does not meet the terrain', status: 422 });
    const error = await api.createTarget({ lat_deg: 1, lon_deg: 2 }).catch((e: unknown) => e);
    expect(error).toBeInstanceOf(ApiError);
    expect((error as ApiError).message).toBe('No ground there: the ray does not meet the terrain');
  });

  it('says that the station does not answer', async () => {
    const api = new RestApi('http://x/', () => Promise.reject(new TypeError('Failed to fetch')));
    await expect(api.flights()).rejects.toMatchObject({ status: null, title: 'The station does not answer' });
  });

});

describe('problemError', () => {
  it('has a sentence for anything', () => {
    expect(problemError(502, '<html>').message).toBe('The station refused (502)');
    expect(problemError(422, JSON.stringify({ title: 'Invalid', errors: [{ loc: ['body', 'u_px'], msg: 'missing' }] })).message).toBe(
      'Invalid: body.u_px: missing',
    );
  });
});
