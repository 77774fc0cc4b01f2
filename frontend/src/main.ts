/** Wiring: one session, one page. Nothing else of the console runs at import. */

import 'ol/ol.css';
import './console.css';
import { mount } from 'svelte';
import { RestApi } from './api/client';
import Console from './panels/Console.svelte';
import { Session } from './panels/session.svelte';
import { LiveSource } from './source/live';
import type { Source } from './source/source';
import type { StationApi } from './api/client';

async function surroundings(): Promise<{ source: Source; api: StationApi }> {
  // Never in the production bundle: the condition is a constant there, and the import is dropped.
  if (import.meta.env.DEV && new URLSearchParams(location.search).has('fake')) {
    const { fakeStation } = await import('./source/fake');
    return fakeStation();
  }
  const base = new URL('.', location.href).toString();
  const name = crypto.randomUUID();
  return { source: new LiveSource(base, name), api: new RestApi(base, undefined, name) };
}

const { source, api } = await surroundings();
const session = new Session(source, api);
mount(Console, { target: document.getElementById('app')!, props: { session } });
session.open();
