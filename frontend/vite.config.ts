import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig } from 'vitest/config';

// During development the page is served by Vite and talks to a station on its usual port.
const station = process.env['PILOTAGE_STATION'] ?? 'http://127.0.0.1:8700';

export default defineConfig({
  base: './',
  plugins: [svelte()],
  build: { target: 'es2022', sourcemap: true, chunkSizeWarningLimit: 900 },
  server: {
    proxy: {
      '/api': { target: station, ws: true },
      '/openapi.json': { target: station },
    },
  },
  // Without css the text of a stylesheet is empty for the tests that read it.
  test: { include: ['src/**/*.test.ts'], environment: 'node', css: true },
});
