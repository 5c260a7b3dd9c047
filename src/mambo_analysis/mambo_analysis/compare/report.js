'use strict';
// Draws the figures and the replay from the JSON of the page, in the colours of the page.
(async () => {
  const packed = Uint8Array.from(atob(document.getElementById('library').textContent),
    (letter) => letter.charCodeAt(0));
  const library = document.createElement('script');
  library.textContent = await new Response(new Blob([packed]).stream()
    .pipeThrough(new DecompressionStream('gzip'))).text();
  document.head.append(library);
  const data = JSON.parse(document.getElementById('data').textContent);
  const { replay } = data;
  const dark = window.matchMedia('(prefers-color-scheme: dark)');
  let onPaper = false; // which is white
  const colour = (name) => data.colours[dark.matches && !onPaper ? 'dark' : 'light'][name];
  const config = { displaylogo: false, displayModeBar: false, doubleClick: false };
  const panning = new Set(); // ids of the figures that a drag moves
  const fit = new ResizeObserver((entries) => entries.forEach(({ target }) => {
    if (target.querySelector('.main-svg')) Plotly.Plots.resize(target);
  }));
  const narrow = () => window.innerWidth <= 700;

  function base() {
    return {
      font: { family: 'system-ui, "Helvetica Neue", Arial, sans-serif', size: 12,
        color: colour('ink') },
      paper_bgcolor: colour('paper'), plot_bgcolor: 'transparent',
      hoverlabel: { bgcolor: colour('paper'), bordercolor: colour('line'),
        font: { color: colour('ink') } },
    };
  }
  const axis = (title) => ({
    title: { text: title, standoff: 6 }, gridcolor: colour('line'), zeroline: false,
    linecolor: colour('soft'), tickcolor: colour('soft'), automargin: true, nticks: 7,
  });

  // ---------------------------------------------------------------- figures

  const unescaped = (text) => new DOMParser().parseFromString(text, 'text/html').body.textContent;
  const escaped = (text) => text.replace(/&/g, '&amp;').replace(/</g, '&lt;');
  const whole = [replay.t[0], replay.t[replay.t.length - 1]];
  let shown = whole; // the stretch of time of every plot

  function traces(line, y) { // of one line
    const base = { type: 'scatter', name: line.name, legendgroup: line.name, xaxis: 'x',
      yaxis: y, connectgaps: false };
    const ink = colour(line.colour);
    if (line.kind === 'band') {
      const border = { ...base, x: line.x, mode: 'lines', line: { width: 0, color: ink },
        hoverinfo: 'skip' };
      return [{ ...border, y: line.low, showlegend: false },
        { ...border, y: line.y, fill: 'tonexty', fillcolor: `${ink}2e` }];
    }
    if (line.kind !== 'line') {
      return [{ ...base, x: line.x, y: line.y, mode: 'markers', hovertemplate: '%{y}',
        marker: { color: ink, size: line.kind === 'dots' ? 3 : 7,
          symbol: line.kind === 'dots' ? 'circle' : 'x-thin-open' } }];
    }
    return [{ ...base, x: line.x, y: line.y, mode: 'lines', hovertemplate: '%{y}',
      line: { color: ink, dash: line.dash, width: line.width } }];
  }

  function marks(bag) { // events as lines, rejected samples as ticks, each one path for speed
    const path = (times, top) => [...new Set(times)].map((t) => `M${t},0L${t},${top}`).join('');
    const here = ([whose]) => !bag || whose === bag;
    const shape = (times, top, role, width) => ({ type: 'path', xref: 'x', yref: 'paper',
      layer: 'below', path: path(times, top), fillcolor: 'transparent',
      line: { color: colour(role), width } });
    const out = ['bad', 'half'].map((role) => [data.events.filter(here)
      .filter((event) => event[1] === role).map((event) => event[2]), 1, role, 1]);
    return [...out, [data.rejected.filter(here).flatMap((row) => row[1]), 0.02, 'soft', 1]]
      .filter(([times]) => times.length).map((row) => shape(...row));
  }

  function draw(figure) {
    const box = document.getElementById(figure.id).querySelector('.plot');
    const n = figure.panels.length;
    const lines = [];
    const named = new Set();
    const layout = { ...base(), margin: { l: 64, r: 8, t: 34, b: 44 },
      hovermode: figure.time ? 'x unified' : 'closest', annotations: [],
      dragmode: panning.has(figure.id) ? 'pan' : narrow() ? false : 'zoom',
      legend: { orientation: 'h', x: 0, y: 1, yref: 'container', yanchor: 'top',
        traceorder: 'reversed' }, shapes: figure.time ? marks(figure.bag) : [] };
    figure.panels.forEach((panel, i) => {
      const k = i ? i + 1 : '';
      panel.lines.forEach((line) => traces(line, `y${k}`).forEach((trace) => {
        const first = !named.has(line.name) && trace.showlegend !== false
          && line.name !== panel.title && (n === 1 || line.colour !== 'ink'
            || line.kind !== 'line' || i === n - 1);
        if (first) named.add(line.name);
        lines.push({ ...trace, showlegend: first });
      }));
      const gap = figure.panels.some(({ title }) => title) ? 0.07 : 0.035;
      const height = (1 - gap * (n - 1)) / n;
      const top = 1 - i * (height + gap);
      layout[`yaxis${k}`] = { ...axis(panel.label), domain: [Math.max(0, top - height), top],
        nticks: 5, ...(figure.log.includes('y') ? { type: 'log', exponentformat: 'power' } : {}),
        ...(panel.limits ? { range: [...panel.limits] } : {}) };
      if (panel.title) {
        layout.annotations.push({ text: escaped(panel.title), x: 1, y: top, xref: 'paper',
          yref: 'paper', xanchor: 'right', yanchor: 'bottom', showarrow: false,
          font: { size: 11, color: colour('soft') } });
      }
    });
    layout.xaxis = { ...axis(figure.across), anchor: `y${n > 1 ? n : ''}`, domain: [0, 1],
      ...(figure.time ? { range: [...shown] } : {}), ...(figure.log.includes('x')
        ? { type: 'log' } : {}) };
    figure.shade.forEach(([from, to]) => layout.shapes.push({ type: 'rect', xref: 'x',
      yref: 'paper', x0: from, x1: to, y0: 0, y1: 1, layer: 'below', line: { width: 0 },
      fillcolor: colour('shade'), opacity: 0.8 }));
    Plotly.react(box, lines, layout, config);
    begin(box, figure);
  }

  function begin(box, figure) { // once for each plot
    if (box.dataset.live) return;
    box.dataset.live = 'yes';
    fit.observe(box);
    box.on('plotly_doubleclick', reset);
    if (!figure.time) return;
    box.dataset.time = 'yes';
    const cursor = document.createElement('div');
    cursor.className = 'cursor';
    box.append(cursor);
    box.on('plotly_afterplot', () => place(box));
    box.on('plotly_relayout', (change) => follow(box, change));
    box.on('plotly_click', (event) => seek(event.points[0].x));
    place(box);
  }

  function place(box) { // the line at the time of the replay
    const { xaxis, _size: size } = box._fullLayout;
    const at = xaxis.l2p(seconds());
    const { style } = box.querySelector('.cursor');
    style.display = at >= 0 && at <= xaxis._length ? 'block' : 'none';
    style.transform = `translateX(${size.l + at}px)`;
    style.top = `${size.t}px`;
    style.height = `${size.h}px`;
  }

  let following = false;
  function relayout(boxes, change) {
    following = true;
    return Promise.all(boxes.map((box) => Plotly.relayout(box, change(box))))
      .finally(() => { following = false; });
  }
  const live = () => [...document.querySelectorAll('.plot[data-live]')];
  const inTime = () => live().filter((box) => box.dataset.time);
  function follow(box, change) { // the others take the stretch of time of the one zoomed into
    if (following) return;
    const range = change['xaxis.range'] || [change['xaxis.range[0]'], change['xaxis.range[1]']];
    if (range[0] === undefined) return;
    shown = [...range];
    relayout(inTime().filter((other) => other !== box), () => ({ 'xaxis.range': [...shown] }));
  }
  function reset() { // all of time and all values, in every plot
    shown = whole;
    const limits = Object.fromEntries(data.figures.map((figure) => [figure.id, figure.panels]));
    relayout(live(), (box) => Object.fromEntries([
      ...(box.dataset.time ? [['xaxis.range', [...whole]]] : [['xaxis.autorange', true]]),
      ...Object.keys(box.layout).filter((key) => key.startsWith('yaxis')).map((key) => {
        const panel = (limits[box.parentElement.id] || [])[Number(key.slice(5) || 1) - 1];
        return panel && panel.limits ? [`${key}.range`, [...panel.limits]]
          : [`${key}.autorange`, true];
      })]));
  }
  function zoom(factor) { // every plot over time, about the cursor
    const about = Math.min(shown[1], Math.max(shown[0], seconds()));
    shown = [Math.max(whole[0], about - factor * (about - shown[0])),
      Math.min(whole[1], about + factor * (shown[1] - about))];
    relayout(inTime(), () => ({ 'xaxis.range': [...shown] }));
  }

  // ---------------------------------------------------------------- mode bars

  function save(name, href) {
    const link = document.createElement('a');
    Object.assign(link, { download: name, href });
    link.click();
  }
  const cell = (value) => { // no cell of a table begins a formula
    const text = String(value ?? '');
    return /^[\d.eE+-]*$/.test(text) ? text
      : `"${text.replace(/^[=+\-@\t\r]/, "'$&").replace(/"/g, '""')}"`;
  };
  function csv(box) { // the points of every curve, one below the other
    const rows = [['curve', 'axis', box.layout.xaxis.title.text, 'value']];
    box.data.forEach((trace) => {
      const label = box.layout[trace.yaxis.replace('y', 'yaxis')].title.text;
      [...trace.x].forEach((x, k) => rows.push([unescaped(trace.name), unescaped(label), x,
        trace.y[k]]));
    });
    return rows.map((row) => row.map(cell).join(',')).join('\r\n');
  }
  function act(what, bar) {
    const id = bar.parentElement.id;
    const box = bar.parentElement.querySelector('.plot');
    const { xaxis } = box._fullLayout;
    if (what === 'reset') reset();
    else if (what === 'png') {
      Plotly.downloadImage(box, { format: 'png', scale: 2, filename: id,
        width: box.clientWidth, height: box.clientHeight });
    } else if (what === 'csv') {
      save(`${id}.csv`, URL.createObjectURL(new Blob([csv(box)], { type: 'text/csv' })));
    } else if (what === 'pan') {
      if (!panning.delete(id)) panning.add(id);
      Plotly.relayout(box, { dragmode: panning.has(id) ? 'pan' : 'zoom' });
      bar.querySelector('[data-do=pan]').setAttribute('aria-pressed', panning.has(id));
    } else {
      const factor = what === 'in' ? 0.5 : 2;
      if (box.dataset.time) zoom(factor);
      else {
        const middle = (xaxis.range[0] + xaxis.range[1]) / 2;
        Plotly.relayout(box, { 'xaxis.range': xaxis.range.map((v) => middle
          + factor * (v - middle)) });
      }
    }
  }
  document.querySelectorAll('.modebar').forEach((bar) => {
    const buttons = [...bar.querySelectorAll('button')];
    bar.addEventListener('click', ({ target }) => { if (target.dataset.do) act(target.dataset.do,
      bar); });
    bar.addEventListener('keydown', (event) => { // one stop of Tab, arrows within
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = buttons[(buttons.indexOf(event.target) + step + buttons.length)
        % buttons.length];
      buttons.forEach((button) => { button.tabIndex = button === next ? 0 : -1; });
      next.focus();
      event.preventDefault();
    });
  });

  // ---------------------------------------------------------------- replay

  const scene = document.getElementById('scene'); // absent without a motion
  const flat = document.getElementById('flat');
  const hasWebGL = (() => {
    if (!scene) return false;
    try { return Boolean(document.createElement('canvas').getContext('webgl')); } catch (e) {
      return false;
    }
  })();
  const extent = (() => { // of all paths: least and greatest of each axis, never flat
    const out = ['x', 'y', 'z'].map((a) => {
      let low = Infinity; let high = -Infinity;
      replay.tracks.forEach((track) => track[a].forEach((v) => {
        if (v !== null) { low = Math.min(low, v); high = Math.max(high, v); }
      }));
      return [low, high];
    });
    out[2][0] = Math.min(out[2][0], 0);
    const size = Math.max(...out.map(([low, high]) => high - low), 0.5);
    return out.map(([low, high]) => {
      const margin = Math.max(0.08 * size, 0.5 * (0.3 * size - (high - low)));
      return [low - margin, high + margin];
    });
  })();
  const span = Math.max(...extent.map(([low, high]) => high - low));
  const arm = 0.045 * span;

  function turn([x, y, z, w], v) { // body to world
    const t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
    return [v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
      v[2] + w * t[2] + x * t[1] - y * t[0]];
  }

  function pose(vehicle, at) { // between two frames; null where there is none
    const i = Math.min(Math.floor(at), replay.t.length - 1);
    const j = Math.min(i + 1, replay.t.length - 1);
    const share = at - i;
    if (vehicle.p[i][0] === null || vehicle.p[j][0] === null) return null;
    const p = vehicle.p[i].map((v, k) => v + share * (vehicle.p[j][k] - v));
    let q = vehicle.q[i];
    if (q[0] !== null && vehicle.q[j][0] !== null) {
      q = q.map((v, k) => v + share * (vehicle.q[j][k] - v));
      const norm = Math.hypot(...q) || 1;
      q = q.map((v) => v / norm);
    } else q = [0, 0, 0, 1];
    return { p, q, known: vehicle.q[i][0] !== null };
  }

  const DIRECTIONS = [[[1, 0, 0], 'estimate'], [[0, 1, 0], 'sonar'], [[0, 0, 1], 'onboard']];
  const CROSS = [[1, 1, 0], [-1, -1, 0], null, [1, -1, 0], [-1, 1, 0]]; // the arms

  function body(vehicle, at) { // lines of a vehicle: arms, then its three axes
    const here = pose(vehicle, at);
    const along = (v, length) => {
      const d = turn(here.q, v);
      return here.p.map((c, k) => c + length * d[k]);
    };
    if (!here) return [[], [], [], []];
    const arms = CROSS.map((v) => (v ? along(v, arm) : [null, null, null]));
    const axes = DIRECTIONS.map(([v]) => (here.known ? [here.p, along(v, 2.2 * arm)] : []));
    return [arms, ...axes];
  }

  const columns = (points) => [0, 1, 2].map((k) => points.map((p) => p[k]));

  function drawScene() {
    if (!scene) return;
    if (!hasWebGL) {
      scene.innerHTML = '<p class="hint">This browser has no WebGL, so the flight is shown from '
        + 'above and from the side only.</p>';
      scene.style.height = 'auto';
      document.getElementById('axes').hidden = true; // only the scene has them
      return;
    }
    const traces = replay.tracks.map((track) => ({ type: 'scatter3d', mode: 'lines',
      name: track.name, x: track.x, y: track.y, z: track.z, hoverinfo: 'name',
      opacity: 0.55,
      line: { color: colour(track.colour), width: track.dash === 'solid' ? 3 : 2,
        dash: track.dash } }));
    replay.vehicles.forEach((vehicle) => {
      body(vehicle, now).forEach((points, part) => {
        const [x, y, z] = columns(points);
        traces.push({ type: 'scatter3d', mode: part ? 'lines' : 'lines+markers', x, y, z,
          name: vehicle.name, showlegend: false, hoverinfo: 'skip', connectgaps: false,
          marker: { size: 4, color: colour(vehicle.colour) },
          line: { color: colour(part ? DIRECTIONS[part - 1][1] : vehicle.colour),
            width: part ? 5 : 8 } });
      });
    });
    const side = (title, k) => ({ title: { text: title, font: { size: 12 } }, range: extent[k],
      gridcolor: colour('line'), zerolinecolor: colour('line'), showbackground: k === 2,
      backgroundcolor: colour('card'), color: colour('soft'), nticks: 6, showspikes: false });
    Plotly.react(scene, traces, { ...base(), margin: { l: 0, r: 0, t: 0, b: 0 },
      uirevision: 'kept', legend: { orientation: 'h', x: 0, y: 1, yanchor: 'top' },
      scene: { aspectmode: 'data', xaxis: side('x [m]', 0), yaxis: side('y [m]', 1),
        zaxis: side('z up [m]', 2), camera: {
          eye: narrow() ? { x: 1.7, y: -1.7, z: 0.95 } : { x: 1.35, y: -1.35, z: 0.75 },
          center: { x: 0, y: 0, z: -0.1 } } } }, config);
  }

  function drawFlat() {
    if (!flat) return;
    const traces = [];
    const legend = !hasWebGL || onPaper; // else the scene beside it has one
    [['x', 'y', ''], ['x', 'z', '2']].forEach(([across, up, k]) => {
      replay.tracks.forEach((track) => traces.push({ type: 'scatter', mode: 'lines',
        name: track.name, showlegend: legend && !k, x: track[across], y: track[up],
        xaxis: `x${k}`, yaxis: `y${k}`, hoverinfo: 'name',
        line: { color: colour(track.colour), width: track.width, dash: track.dash } }));
    });
    replay.vehicles.forEach((vehicle) => ['', '2'].forEach((k) => traces.push({ type: 'scatter',
      mode: 'markers', x: [], y: [], xaxis: `x${k}`, yaxis: `y${k}`, showlegend: false,
      hoverinfo: 'skip', name: vehicle.name, marker: { size: 11, color: colour(vehicle.colour),
        line: { color: colour('paper'), width: 1.5 } } })));
    const heights = [extent[1][1] - extent[1][0], extent[2][1] - extent[2][0]];
    const cut = Math.min(0.7, Math.max(0.3, heights[1] / (heights[0] + heights[1])));
    Plotly.react(flat, traces, { ...base(), margin: { l: 56, r: 8, t: legend ? 56 : 24, b: 44 },
      legend: { orientation: 'h', x: 0, y: 1.06, yanchor: 'bottom' }, dragmode: false,
      xaxis: { ...axis(''), range: extent[0], domain: [0, 1], anchor: 'y' },
      yaxis: { ...axis('y [m]'), range: extent[1], scaleanchor: 'x', constrain: 'domain',
        domain: [cut + 0.08, 1] },
      xaxis2: { ...axis('x [m]'), range: extent[0], matches: 'x', anchor: 'y2' },
      yaxis2: { ...axis('z up [m]'), range: extent[2], scaleanchor: 'x2', constrain: 'domain',
        domain: [0, cut - 0.04] },
      annotations: [['from above', 1], ['from the side', cut - 0.04]].map(([text, y]) => ({ text,
        x: 1, y, xref: 'paper', yref: 'paper', xanchor: 'right', yanchor: 'bottom',
        showarrow: false, font: { color: colour('soft') } })) }, config);
    showFlat();
  }

  function showFlat() {
    const first = 2 * replay.tracks.length;
    const x = []; const y = []; const which = [];
    replay.vehicles.forEach((vehicle, i) => {
      const here = pose(vehicle, now);
      [1, 2].forEach((up, k) => {
        x.push(here ? [here.p[0]] : []);
        y.push(here ? [here.p[up]] : []);
        which.push(first + 2 * i + k);
      });
    });
    Plotly.restyle(flat, { x, y }, which);
  }

  function showScene() {
    const first = replay.tracks.length;
    const parts = replay.vehicles.flatMap((vehicle) => body(vehicle, now)).map(columns);
    Plotly.restyle(scene, { x: parts.map((p) => p[0]), y: parts.map((p) => p[1]),
      z: parts.map((p) => p[2]) }, parts.map((_, i) => first + i));
  }

  const play = document.getElementById('play');
  const slider = document.getElementById('when');
  const clock = document.getElementById('clock');
  const speed = document.getElementById('speed');
  const last = replay.t.length - 1;
  const rate = last / Math.max(replay.t[last] - replay.t[0], 1e-9); // frames in a second
  let now = 0; // in frames
  let playing = false;

  const seconds = () => replay.t[0] + now / rate;
  function show() {
    slider.value = now;
    clock.value = `${seconds().toFixed(2)} s`;
    if (hasWebGL) showScene();
    if (flat) showFlat();
    inTime().forEach(place);
    showPair();
  }
  function seek(t) {
    now = Math.min(last, Math.max(0, (t - replay.t[0]) * rate));
    show();
  }
  function run(on) {
    playing = on;
    play.textContent = on ? '❚❚' : '▶';
    play.setAttribute('aria-label', on ? 'pause' : 'play');
    if (!on) return;
    if (now >= last) now = 0;
    let before = performance.now();
    const step = (when) => {
      if (!playing) return;
      if (when - before >= 30) {
        now = Math.min(last, now + (when - before) * 1e-3 * rate * Number(speed.value));
        before = when;
        show();
        if (now >= last) { run(false); return; }
      }
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
  slider.max = last;
  slider.addEventListener('input', () => { now = Number(slider.value); show(); });
  play.addEventListener('click', () => run(!playing));
  document.querySelectorAll('.when').forEach((button) => button.addEventListener('click',
    () => seek(Number(button.dataset.t))));
  document.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey
      || event.target.closest('button, input, select, summary, [tabindex]')) return;
    const step = event.shiftKey ? 1 : 0.1;
    const todo = { ' ': () => run(!playing), ArrowLeft: () => seek(seconds() - step),
      ArrowRight: () => seek(seconds() + step), '+': () => zoom(0.5), '-': () => zoom(2),
      0: reset }[event.key];
    if (!todo) return;
    todo();
    event.preventDefault();
  });

  // ---------------------------------------------------------------- any signal against any other

  const [across, up] = ['across', 'up'].map((name) => document.getElementById(name));
  const pick = ({ value }) => (value === '' ? data.signals.t : data.signals.values[value]);
  const label = (choice) => escaped(choice.selectedOptions[0].textContent);
  function drawPair() {
    if (!across) return;
    const box = document.querySelector('#explore .plot');
    const name = `${label(up)} against ${label(across)}`;
    Plotly.react(box, [{ type: 'scatter', mode: 'lines+markers', name, x: pick(across),
      y: pick(up), xaxis: 'x', yaxis: 'y', showlegend: false, connectgaps: false,
      line: { color: colour('onboard'), width: 0.7 }, marker: { size: 3 } },
    { type: 'scatter', mode: 'markers', name: 'now', x: [], y: [], xaxis: 'x', yaxis: 'y',
      showlegend: false, hoverinfo: 'skip', marker: { size: 11, color: colour('estimate') } }],
    { ...base(), margin: { l: 64, r: 8, t: 12, b: 44 }, xaxis: axis(label(across)),
      yaxis: axis(label(up)), hovermode: 'closest', dragmode: narrow() ? false : 'zoom' }, config);
    begin(box, { time: false });
    showPair();
  }
  function showPair() { // the point at the time of the replay
    const box = document.querySelector('#explore .plot[data-live]');
    if (!box) return;
    const { t } = data.signals;
    const k = Math.round((seconds() - t[0]) / Math.max(t[t.length - 1] - t[0], 1e-9)
      * (t.length - 1));
    Plotly.restyle(box, { x: [[pick(across)[k]]], y: [[pick(up)[k]]] }, [1]);
  }
  if (across) {
    [across, up].forEach((choice, which) => {
      ['time [s]', ...data.signals.names].forEach((name, k) => {
        const option = document.createElement('option');
        option.textContent = name;
        option.value = k ? k - 1 : '';
        choice.append(option);
      });
      choice.value = Math.min(which, data.signals.names.length - 1);
      choice.addEventListener('change', drawPair);
    });
  }

  // ---------------------------------------------------------------- when to draw

  const waiting = new Map();
  const observer = new IntersectionObserver((entries) => entries.forEach((entry) => {
    if (!entry.isIntersecting || !waiting.has(entry.target)) return;
    observer.unobserve(entry.target);
    waiting.get(entry.target)();
    waiting.delete(entry.target);
  }), { rootMargin: '600px' });
  const wait = (id, how) => {
    const box = document.getElementById(id);
    waiting.set(box, how);
    observer.observe(box);
  };
  now = Math.round(0.4 * last);
  data.figures.forEach((figure) => wait(figure.id, () => draw(figure)));
  if (across) wait('explore', drawPair);
  function rest() { waiting.forEach((how) => how()); waiting.clear(); }
  drawScene();
  drawFlat();
  [scene, flat].filter(Boolean).forEach((box) => fit.observe(box));
  show();
  function again() { // in other colours
    drawScene();
    drawFlat();
    data.figures.forEach((figure) => {
      if (!waiting.has(document.getElementById(figure.id))) draw(figure);
    });
    if (across && !waiting.has(document.getElementById('explore'))) drawPair();
  }
  window.addEventListener('beforeprint', () => {
    onPaper = true;
    if (dark.matches) again(); else drawFlat();
    rest();
    document.querySelectorAll('.plot .main-svg, #flat .main-svg').forEach((svg) => { // to scale
      svg.setAttribute('viewBox', `0 0 ${svg.getAttribute('width')} ${svg.getAttribute('height')}`);
    });
  });
  window.addEventListener('afterprint', () => {
    onPaper = false;
    if (dark.matches) again(); else drawFlat();
  });
  dark.addEventListener('change', again);
  document.documentElement.dataset.ready = hasWebGL ? 'webgl' : 'flat';
})();
