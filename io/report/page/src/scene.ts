// The section of the 3-D view: its controls, and the code of the view, which is started when the reader comes to it.
import type { Context } from './data';
import { h, missing, section, type Section } from './dom';
import { plural } from './format';
import { choose, choosePart, chosenSample, colours, onChoice, onPart, onTheme } from './state';
import type { Options, Residual, View3d } from './view3d';

interface Module { create(host: HTMLElement, options: Options): View3d }

/** Runs the text of the 3-D view: a script of the page itself, parsed only now. */
function module(): Module {
  const page = globalThis as { kincalView3d?: Module };
  if (!page.kincalView3d) document.head.append(h('script', {}, document.getElementById('view3d')?.textContent ?? ''));
  if (!page.kincalView3d) throw new Error('the 3-D view is not in this file');
  return page.kincalView3d;
}

function residualsOf(context: Context, sample: number): Residual[] {
  const { residuals, sensors, targets } = context;
  const [x, y, z] = ['x', 'y', 'z'].map((name) => residuals.column(name));
  const id = residuals.ints('id'), sensor = residuals.ints('sensor'), target = residuals.ints('target');
  return Array.from(residuals.rowsOf(sample), (i) => ({
    sensor: sensors[sensor[i]], target: targets[target[i]], id: id[i], r: [x[i], y[i], z[i] || 0],
    px: context.result.sensors?.[sensors[sensor[i]]]?.unit === 'px',
  }));
}

export function sceneSection(context: Context): Section {
  const plan = context.result.kind === 'plan';
  return section('robot', plan ? 'The robot in the planned postures' : 'The robot, before and after',
    plan ? 'Thick: the robot in the chosen posture. Thin: in all others. Drag to turn, scroll to zoom. To choose a posture, click the sensor or target at the end of a thin line, or use the list at the lower edge.' :
    'Solid: after the calibration. Orange: the same part before, with the difference magnified. Ellipsoids: one standard deviation of the position of a sensor or target, magnified. Dots: the targets in all samples. Arrows: from each point of the chosen sample towards the place where the sensor saw it, magnified. Drag to turn, scroll to zoom. Click a dot to choose its sample, a sensor or target to mark it in the whole page.',
    (host) => {
      const scene = context.result.scene;
      if (!scene?.links.length) return void host.append(missing('The robot’s links are not in this file.'));
      const place = h('div', { class: 'view3d' });
      const controls = h('div', { class: 'controls' });
      host.append(controls, place);
      let view: View3d;
      try {
        view = module().create(place, {
          scene, samples: context.samples, colours: colours(), sample: chosenSample(), choose: (sample) => choose(sample, false), choosePart,
          residuals: (sample) => residualsOf(context, sample), postures: plan,
        });
      } catch (error) {
        place.replaceChildren(missing(`This browser shows no 3-D graphics (${error instanceof Error ? error.message : error}).`));
        place.classList.add('none');
        return;
      }
      const slider = (label: string, most: number, start: number, set: (value: number) => void) => {
        const shown = h('output', {}, `× ${start}`);
        // Even steps on a logarithmic line: 1 to 100 is two decades.
        const input = h('input', {
          type: 'range', min: 0, max: 100, value: (100 * Math.log10(start)) / Math.log10(most), 'aria-label': label,
          input: () => { const v = Math.round(most ** (Number(input.value) / 100)); shown.textContent = `× ${v}`; set(v); },
        });
        return h('label', {}, label, input, shown);
      };
      const box = (label: string, checked: boolean, set: (on: boolean) => void) => {
        const input = h('input', { type: 'checkbox', checked, change: () => set(input.checked) });
        return h('label', {}, input, label);
      };
      if (plan) view.show('before', false);
      else controls.append(slider('Difference', 100, view.start.difference, view.difference));
      if ([...scene.sensors, ...scene.targets].some((s) => s.covariance)) controls.append(slider('Uncertainty', 1000, view.start.uncertainty, view.uncertainty),
        box('uncertainty', true, (on) => view.show('ellipsoids', on)));
      if (context.residuals.length) controls.append(slider('Residuals', 10000, view.start.residuals, view.residuals),
        box('residuals of the chosen sample', true, (on) => view.show('arrows', on)));
      controls.append(plan ? box('all postures', true, (on) => view.show('postures', on)) : box('before', true, (on) => view.show('before', on)), box('names', true, (on) => view.show('names', on)),
        box('axes', false, (on) => view.show('axes', on)));
      if (scene.links.some((l) => l.boxes?.length)) controls.append(box('bodies', true, (on) => view.show('bodies', on)));
      controls.append(h('button', { type: 'button', click: () => view.home() }, 'Whole robot'));
      if (scene.meshes_left_out) host.append(h('p', { class: 'small' },
        `${plural(scene.meshes_left_out, 'link')} drawn without a body: the URDF names the meshes by package://, or they are Collada or OBJ.`));
      onChoice(view.choose);
      onPart((part) => view.mark(part));
      onTheme(() => view.paint(colours()));
    }, 560, '0px');
}
