/** An upload from wherever it was started. */

import type { Session } from './session.svelte';

export async function importMap(session: Session, file: File, progress: (fraction: number) => void = () => undefined) {
  session.say('info', `Importing ${file.name} …`);
  const map = await session.attempt(`Importing ${file.name}`, () => session.api.importMap(file, progress));
  if (map) session.say('info', `${map.name} is imported.`);
  return map;
}
