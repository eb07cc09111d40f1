// Builds built/report.html: one file that needs nothing else. The page itself is inlined by vite-plugin-singlefile.
// The 3-D view (three.js is most of the bytes) is built apart and stands in the page as text that nobody runs until
// the reader comes to it: the first screen does not wait for it.
import { readFileSync } from 'node:fs';
import { resolve } from 'node:path';
import { build, defineConfig, type Plugin } from 'vite';
import { viteSingleFile } from 'vite-plugin-singlefile';

const here = import.meta.dirname;

function licence(name: string): string {
  const folder = resolve(here, 'node_modules', name);
  const version = JSON.parse(readFileSync(resolve(folder, 'package.json'), 'utf8')).version;
  return `${name} ${version}\n\n${readFileSync(resolve(folder, 'LICENSE'), 'utf8').trim()}\n`;
}

async function view3dCode(): Promise<string> {
  const result = await build({
    root: here, configFile: false, logLevel: 'warn', publicDir: false,
    build: {
      write: false, target: 'es2022',
      lib: { entry: resolve(here, 'src/view3d.ts'), formats: ['iife'], name: 'kincalView3d' },
    },
  });
  const outputs = (Array.isArray(result) ? result : [result]) as { output: { type: string; code?: string }[] }[];
  const code = outputs[0].output.find((chunk) => chunk.type === 'chunk')!.code!;
  return code.replace(/<\/script/gi, '<\\/script').replace(/<!--/g, '<\\!--');
}

function wholePage(): Plugin {
  return {
    name: 'whole-page', apply: 'build', enforce: 'post',
    generateBundle: {
      order: 'post',
      async handler(_, bundle) {
        const page = bundle['index.html'];
        if (page?.type !== 'asset') throw new Error('there is no index.html');
        const texts: Record<string, string> = {
          '@licences@': ['three', 'uplot'].map(licence).join('\n'),
          '@view3d@': await view3dCode(),
        };
        page.source = String(page.source).replace(/@licences@|@view3d@/g, (key) => texts[key]);
        page.fileName = 'report.html';
      },
    },
  };
}

export default defineConfig({
  root: here,
  plugins: [viteSingleFile({ removeViteModuleLoader: true }), wholePage()],
  build: {
    outDir: 'built', emptyOutDir: true, target: 'es2022', modulePreload: false,
  },
});
