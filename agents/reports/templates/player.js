"use strict";
(() => {
  const data = JSON.parse(document.getElementById("recording").textContent);
  const part = (id) => document.getElementById(id);
  const scene = part("scene");
  const timeline = part("timeline");
  const stage = scene.parentElement;
  const ROD_COLOURS = ["#1d4ed8", "#0f766e", "#7c3aed", "#b45309"];
  const ALARM = "#dc2626";
  const INK = "#111827";
  const END_PAUSE_MS = 1200;
  const VIEW_MARGIN = 0.06;
  const successRadius = data.success_distance / data.resolution;

  const state = { episode: 0, frame: 0, isPlaying: false, due: 0 };
  const episode = () => data.episodes[state.episode];
  const frame = () => episode().frames[state.frame];

  // The view holds everything that is ever drawn, so that nothing moves but the mechanism.
  const view = (() => {
    const box = { xMin: Infinity, xMax: -Infinity, yMin: Infinity, yMax: -Infinity };
    const include = (x, y) => {
      box.xMin = Math.min(box.xMin, x);
      box.xMax = Math.max(box.xMax, x);
      box.yMin = Math.min(box.yMin, y);
      box.yMax = Math.max(box.yMax, y);
    };
    for (const actuator of data.actuators) (actuator.rail || [actuator.base]).forEach(([x, y]) => include(x, y));
    for (const { frames } of data.episodes)
      for (const { goal, rods } of frames) {
        include(goal[0] - successRadius, goal[1] - successRadius);
        include(goal[0] + successRadius, goal[1] + successRadius);
        for (const rod of rods) for (let i = 0; i < rod.length; i += 2) include(rod[i], rod[i + 1]);
      }
    const margin = VIEW_MARGIN * Math.max(box.xMax - box.xMin, box.yMax - box.yMin);
    return { xMin: box.xMin - margin, xMax: box.xMax + margin, yMin: box.yMin - margin, yMax: box.yMax + margin };
  })();

  // A canvas at the device's resolution; returns its context, in CSS pixels, and its size.
  function prepare(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineCap = "round";
    context.lineJoin = "round";
    return { context, width, height };
  }

  function projection(width, height) {
    const scale = Math.min(width / (view.xMax - view.xMin), height / (view.yMax - view.yMin));
    const xOffset = (width - scale * (view.xMin + view.xMax)) / 2;
    const yOffset = (height + scale * (view.yMin + view.yMax)) / 2;
    return { scale, at: (x, y) => [xOffset + scale * x, yOffset - scale * y] };
  }

  function tracePoints(context, at, points) {
    context.beginPath();
    points.forEach(([x, y], index) => (index ? context.lineTo(...at(x, y)) : context.moveTo(...at(x, y))));
  }

  function drawGrid(context, { scale, at }, width, height) {
    const spacing = 0.1 / data.resolution;
    context.strokeStyle = "rgba(17, 24, 39, 0.06)";
    context.lineWidth = 1;
    context.beginPath();
    const [xZero, yZero] = at(0, 0);
    const pitch = spacing * scale;
    for (let x = xZero - Math.ceil(xZero / pitch) * pitch; x < width; x += pitch) {
      context.moveTo(x, 0);
      context.lineTo(x, height);
    }
    for (let y = yZero - Math.ceil(yZero / pitch) * pitch; y < height; y += pitch) {
      context.moveTo(0, y);
      context.lineTo(width, y);
    }
    context.stroke();
    context.fillStyle = "#6b7280";
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "right";
    context.fillText("grid 0.1 m", width - 10, height - 10);
  }

  function drawGoal(context, { scale, at }) {
    const [x, y] = at(...frame().goal);
    const radius = Math.max(successRadius * scale, 3);
    context.fillStyle = "rgba(4, 120, 87, 0.18)";
    context.strokeStyle = "#047857";
    context.lineWidth = 1.5;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * (radius + 2), y + dy * (radius + 2));
      context.lineTo(x + dx * (radius + 8), y + dy * (radius + 8));
    }
    context.stroke();
    if (frame().goal_hinges.length > 2) {
      context.setLineDash([4, 4]);
      tracePoints(context, at, frame().goal_hinges);
      context.closePath();
      context.stroke();
      context.setLineDash([]);
    }
  }

  function drawTrail(context, { at }) {
    const tips = episode().frames.slice(0, state.frame + 1).map(({ tip }) => tip);
    context.strokeStyle = "rgba(217, 119, 6, 0.75)";
    context.lineWidth = 1.5;
    tracePoints(context, at, tips);
    context.stroke();
  }

  function drawRails(context, { at }) {
    context.strokeStyle = "#9ca3af";
    context.lineWidth = 3;
    for (const { kind, rail } of data.actuators)
      if (kind === "prismatic") {
        tracePoints(context, at, rail);
        context.stroke();
      }
  }

  // The clamp: a motor's disc or a slider's block at the rod's base, with a stub along the clamped tangent.
  function drawActuators(context, { at }) {
    frame().rods.forEach((rod, leg) => {
      const [x, y] = at(rod[0], rod[1]);
      const [xNext, yNext] = at(rod[2], rod[3]);
      const angle = Math.atan2(yNext - y, xNext - x);
      context.save();
      context.translate(x, y);
      context.rotate(angle);
      context.fillStyle = "#fff";
      context.strokeStyle = INK;
      context.lineWidth = 2;
      context.beginPath();
      if (data.actuators[leg].kind === "revolute") context.arc(0, 0, 8, 0, 2 * Math.PI);
      else context.rect(-8, -6, 16, 12);
      context.fill();
      context.stroke();
      context.beginPath();
      context.moveTo(0, 0);
      context.lineTo(13, 0);
      context.lineWidth = 4;
      context.stroke();
      context.restore();
    });
  }

  function drawRods(context, { at }) {
    context.lineWidth = 3.5;
    frame().rods.forEach((rod, leg) => {
      context.strokeStyle = frame().unstable ? ALARM : ROD_COLOURS[leg % ROD_COLOURS.length];
      context.beginPath();
      context.moveTo(...at(rod[0], rod[1]));
      for (let i = 2; i < rod.length; i += 2) context.lineTo(...at(rod[i], rod[i + 1]));
      context.stroke();
    });
  }

  function drawEndEffector(context, { at }) {
    const hinges = frame().rods.map((rod) => rod.slice(-2));
    context.fillStyle = frame().unstable ? "rgba(220, 38, 38, 0.25)" : "rgba(17, 24, 39, 0.15)";
    context.strokeStyle = frame().unstable ? ALARM : INK;
    context.lineWidth = 2;
    if (hinges.length > 2) {
      tracePoints(context, at, hinges);
      context.closePath();
      context.fill();
      context.stroke();
    }
    context.fillStyle = "#fff";
    for (const [x, y] of hinges) {
      context.beginPath();
      context.arc(...at(x, y), 4, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
  }

  function drawScene() {
    const { context, width, height } = prepare(scene);
    const projected = projection(width, height);
    drawGrid(context, projected, width, height);
    drawRails(context, projected);
    drawGoal(context, projected);
    drawTrail(context, projected);
    drawRods(context, projected);
    drawActuators(context, projected);
    drawEndEffector(context, projected);
  }

  // Distance from the goal over the episode, on a logarithmic scale; unstable steps are red bars.
  function drawTimeline() {
    const { context, width, height } = prepare(timeline);
    const frames = episode().frames;
    const last = Math.max(frames.length - 1, 1);
    const floor = data.success_distance / 30;
    const errors = frames.map(({ error }) => Math.log(Math.max(error, floor)));
    const low = Math.min(Math.log(data.success_distance), ...errors) - 0.2;
    const high = Math.max(Math.log(data.success_distance), ...errors) + 0.2;
    const xAt = (index) => 8 + ((width - 16) * index) / last;
    const yAt = (value) => height - 6 - ((height - 12) * (value - low)) / (high - low);
    context.fillStyle = "rgba(220, 38, 38, 0.85)";
    frames.forEach(({ unstable }, index) => unstable && context.fillRect(xAt(index) - 2, 0, 4, height));
    context.strokeStyle = "#047857";
    context.setLineDash([4, 4]);
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(xAt(0), yAt(Math.log(data.success_distance)));
    context.lineTo(xAt(last), yAt(Math.log(data.success_distance)));
    context.stroke();
    context.setLineDash([]);
    context.strokeStyle = "#1d4ed8";
    context.lineWidth = 1.8;
    context.beginPath();
    errors.forEach((value, index) => context[index ? "lineTo" : "moveTo"](xAt(index), yAt(value)));
    context.stroke();
    context.fillStyle = INK;
    context.beginPath();
    context.arc(xAt(state.frame), yAt(errors[state.frame]), 4.5, 0, 2 * Math.PI);
    context.fill();
  }

  function showReadout() {
    const { unstable, event, error, margin } = frame();
    const isReached = !unstable && error <= data.success_distance;
    stage.classList.toggle("unstable", unstable);
    part("badge").classList.toggle("reached", isReached);
    part("badge").textContent = unstable ? `UNSTABLE${event === "none" ? "" : ": " + event}` : isReached ? "at the goal" : "stable";
    part("step").textContent = `${state.frame} of ${episode().frames.length - 1}`;
    part("error").textContent = `${(1000 * error).toFixed(1)} mm`;
    part("margin").textContent = margin === null ? "\u2013" : margin.toPrecision(3);
    part("event").textContent = event;
    part("scrubber").value = state.frame;
  }

  function draw() {
    drawScene();
    drawTimeline();
    showReadout();
  }

  function goTo(index) {
    state.frame = Math.min(Math.max(index, 0), episode().frames.length - 1);
    draw();
  }

  function choose(index) {
    state.episode = (index + data.episodes.length) % data.episodes.length;
    part("episode").value = state.episode;
    part("scrubber").max = episode().frames.length - 1;
    goTo(0);
  }

  function setPlaying(isPlaying) {
    state.isPlaying = isPlaying;
    state.due = 0;
    part("play").textContent = isPlaying ? "Pause" : "Play";
    if (isPlaying) requestAnimationFrame(tick);
  }

  function tick(now) {
    if (!state.isPlaying) return;
    if (state.due === 0) state.due = now + 1000 / Number(part("speed").value);
    if (now >= state.due) advance(now);
    requestAnimationFrame(tick);
  }

  function advance(now) {
    const isAtEnd = state.frame === episode().frames.length - 1;
    if (isAtEnd) choose(state.episode + 1);
    else goTo(state.frame + 1);
    const isNowAtEnd = state.frame === episode().frames.length - 1;
    state.due = now + (isNowAtEnd ? END_PAUSE_MS : 1000 / Number(part("speed").value));
  }

  function seek(index) {
    setPlaying(false);
    goTo(index);
  }

  data.episodes.forEach(({ policy, seed, outcome }, index) => {
    part("episode").add(new Option(`${policy}, seed ${seed}: ${outcome}`, index));
  });
  part("episode").addEventListener("change", ({ target }) => choose(Number(target.value)));
  part("previous").addEventListener("click", () => choose(state.episode - 1));
  part("next").addEventListener("click", () => choose(state.episode + 1));
  part("play").addEventListener("click", () => setPlaying(!state.isPlaying));
  part("scrubber").addEventListener("input", ({ target }) => seek(Number(target.value)));
  timeline.addEventListener("click", ({ offsetX }) => {
    seek(Math.round(((offsetX - 8) / (timeline.clientWidth - 16)) * (episode().frames.length - 1)));
  });
  window.addEventListener("resize", draw);
  choose(0);
  setPlaying(!window.matchMedia("(prefers-reduced-motion: reduce)").matches);
})();
