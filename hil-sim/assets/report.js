// Draws every plot of the page from its data, anew when the colour scheme or the medium changes.
(() => {
  "use strict";
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const root = document.documentElement;
  const FAMILY = "system-ui, sans-serif";
  const FONT = `12px ${FAMILY}`;
  let charts = [];

  const named = (axis) => axis.unit ? `${axis.label} [${axis.unit}]` : axis.label;
  const rounded = (value, digits) => {
    const short = Number(value.toPrecision(digits));
    const size = Math.abs(short);
    return short && (size < 1e-3 || size >= 1e6) ? short.toExponential() : String(short);
  };
  const shown = (value, unit) =>
    value == null ? "–" : rounded(value, 4) + (unit ? ` ${unit}` : "");
  // A value on an axis, or its name.
  const at = (axis, value) =>
    axis.names.find(([named]) => named * axis.factor === value)?.[1] ?? shown(value, axis.unit);
  const scaled = (values, factor) => values.map((v) => (v == null ? null : v * factor));

  // One row of abscissae for all series: uPlot joins them, with gaps only where data has them.
  const joined = (plot) => {
    const tables = plot.series.map((s) => [scaled(s.x, plot.x.factor), scaled(s.y, plot.y.factor)]);
    if (tables.every((t) => t[0].length === tables[0][0].length
        && t[0].every((v, i) => v === tables[0][0][i]))) {
      return [tables[0][0], ...tables.map((t) => t[1])];
    }
    return uPlot.join(tables);
  };

  // A vertical one is named above the plot, where no line can run through its name.
  const markers = (plot, color) => (u) => {
    const { ctx, bbox } = u;
    const [right, bottom] = [bbox.left + bbox.width, bbox.top + bbox.height];
    const pixels = (count) => count * devicePixelRatio;
    ctx.save();
    ctx.font = `${pixels(12)}px ${FAMILY}`;
    ctx.textBaseline = "bottom";
    ctx.lineWidth = pixels(1);
    for (const { vertical, value, label } of plot.markers) {
      const [axis, scale] = vertical ? [plot.x, "x"] : [plot.y, "y"];
      const at = u.valToPos(value * axis.factor, scale, true);
      if (!(vertical ? at >= bbox.left && at <= right : at >= bbox.top && at <= bottom)) continue;
      ctx.strokeStyle = ctx.fillStyle = color("--soft");
      ctx.setLineDash([pixels(2), pixels(4)]);
      ctx.beginPath();
      ctx.moveTo(vertical ? at : bbox.left, vertical ? bbox.top : at);
      ctx.lineTo(vertical ? at : right, vertical ? bottom : at);
      ctx.stroke();
      const half = ctx.measureText(label).width / 2;
      const wanted = vertical ? at : right - half - pixels(3);
      const x = Math.min(Math.max(wanted, half), ctx.canvas.width - half);
      const y = (vertical ? bbox.top : at) - pixels(3);
      ctx.textAlign = "center";
      ctx.strokeStyle = color("--panel");
      ctx.setLineDash([]);
      ctx.lineWidth = pixels(4);
      ctx.strokeText(label, x, y);
      ctx.lineWidth = pixels(1);
      ctx.fillText(label, x, y);
    }
    ctx.restore();
  };

  // The band of a line, in stretches without gaps: [x, y] in the plot's units, there and back.
  const bands = (plot, data, shown) => plot.series.flatMap((s, i) => {
    if (!s.band || !shown(i)) return [];
    const half = s.band * plot.y.factor;
    const stretches = [[]];
    data[i + 1].forEach((y, row) => {
      if (y === null) stretches.push([]);
      else if (y !== undefined) stretches.at(-1).push([data[0][row], y]);
    });
    return stretches.filter((points) => points.length > 1).map((points) => ({ series: i, corners: [
      ...points.map(([x, y]) => [x, y + half]), ...points.reverse().map(([x, y]) => [x, y - half]),
    ] }));
  });

  const radius = (s) => (s.dashed ? 7 : 4.5);
  const OPACITY = 0.25;
  const shade = (plot, lineColor) => (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.globalAlpha = OPACITY;
    for (const { series, corners } of bands(plot, u.data, (i) => u.series[i + 1].show)) {
      ctx.fillStyle = lineColor(u, series + 1);
      ctx.beginPath();
      corners.forEach(([x, y]) => ctx.lineTo(u.valToPos(x, "x", true), u.valToPos(y, "y", true)));
      ctx.fill();
    }
    ctx.restore();
  };

  // Edges of a band that is thinner than this would hide what they enclose [px].
  const EDGES_MIN = 8;
  const hasEdges = (u, plot, { role, band }) => role === "noise"
    && 2 * Math.abs(u.valToPos(0, "y") - u.valToPos(band * plot.y.factor, "y")) >= EDGES_MIN;

  // The edges of the noise, over the lines that fill its band.
  const edges = (plot, color) => (u) => {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = color("--ink");
    ctx.lineWidth = devicePixelRatio;
    const noise = (i) => u.series[i + 1].show && hasEdges(u, plot, plot.series[i]);
    for (const { corners } of bands(plot, u.data, noise)) {
      ctx.beginPath();
      corners.forEach(([x, y], i) => {
        const pen = i === corners.length / 2 ? "moveTo" : "lineTo";
        ctx[pen](u.valToPos(x, "x", true), u.valToPos(y, "y", true));
      });
      ctx.stroke();
    }
    ctx.restore();
  };

  // All ordinates get the room of the widest, so that time axes stand below each other.
  const pen = document.createElement("canvas").getContext("2d");
  let widest = 0;
  const room = (u, ticks) => {
    pen.font = FONT;
    const width = Math.max(0, ...(ticks || []).map((tick) => pen.measureText(tick ?? "").width));
    if (width > widest) {
      widest = width;
      queueMicrotask(() => { for (const chart of charts) chart.redraw(false, true); });
    }
    return Math.ceil(widest) + 20;
  };

  const height = (width) => Math.round(Math.min(340, Math.max(260, width * 0.55)));

  const options = (plot, width) => {
    const style = getComputedStyle(root);
    const color = (name) => style.getPropertyValue(name).trim();
    const lineColor = (u, line) =>
      color(`--${plot.series[line - 1]?.role ?? `c${(line - 1) % 6}`}`);
    const axis = (of, size) => ({
      label: named(of), stroke: color("--ink"), labelFont: FONT, font: FONT, labelSize: 20, size,
      ...(of.names.length ? {
        splits: () => of.names.map(([value]) => value * of.factor),
        values: () => of.names.map(([, name]) => name),
      } : {
        // uPlot's own numbers end at the third decimal.
        values: (u, ticks) => ticks.map((tick) => (tick == null ? "" : rounded(tick, 6))),
      }),
      grid: { stroke: color("--rule"), width: 1 }, ticks: { stroke: color("--rule"), width: 1 },
    });
    const log = (of) => (of.log ? { distr: 3 } : {});
    // A line across is there to be compared with: it stays in sight.
    const across = plot.markers.filter((marker) => !marker.vertical)
      .map((marker) => marker.value * plot.y.factor);
    const around = (u, min, max) => {
      if (min == null) return [null, null];
      const [low, high] = [Math.min(min, ...across), Math.max(max, ...across)];
      if (plot.y.log) return uPlot.rangeLog(low, high, 10, false);
      const pad = (high - low || Math.abs(high) || 1) * 0.05;
      return [low - pad, high + pad];
    };
    return {
      width, height: height(width),
      padding: [plot.markers.some((marker) => marker.vertical) ? 22 : null, null, null, null],
      scales: {
        // As dragged: by itself a logarithmic scale would widen to whole decades.
        x: { time: false, ...log(plot.x), range: (u, min, max) => [min, max] },
        y: { ...log(plot.y), range: around },
      },
      axes: [axis(plot.x, 38), axis(plot.y, room)],
      series: [{ label: plot.x.label, value: (u, v) => at(plot.x, v) },
        ...plot.series.map((s) => ({
          label: s.name, stroke: lineColor, width: 1.8, dash: s.dashed ? [7, 5] : undefined,
          spanGaps: false, value: (u, v) => shown(v, plot.y.unit),
          ...(s.points ? {
            paths: () => null,
            // A model's are rings, in which others stay visible.
            points: { show: true, size: 2 * radius(s), width: 2, fill: s.dashed ? "transparent" : lineColor },
          } : { points: { show: false } }),
        }))],
      cursor: {
        drag: { x: true, y: false, setScale: true }, focus: { prox: 24 },
        sync: plot.sync ? { key: plot.sync, setSeries: false } : undefined,
      },
      legend: { markers: {
        stroke: lineColor, width: 3,
        dash: (u, line) => (plot.series[line - 1]?.dashed ? "dashed" : "solid"),
      } },
      hooks: { drawAxes: [shade(plot, lineColor)], draw: [edges(plot, color), markers(plot, color)] },
    };
  };

  // What can be saved of a plot: its numbers, and its picture as it is shown.
  const table = (chart, plot) => {
    const cell = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const banded = plot.series.filter((s) => s.band);
    const lines = [...plot.series.map((s) => s.name), ...banded.map((s) => `± about ${s.name}`)]
      .map((label) => named({ label, unit: plot.y.unit }));
    const halves = banded.map((s) => s.band * plot.y.factor);
    const rows = chart.data[0].map((_, row) =>
      [...chart.data.map((column) => column[row] ?? ""), ...halves]);
    return [[named(plot.x), ...lines].map(cell), ...rows].map((row) => `${row.join(",")}\n`).join("");
  };

  const [HEAD, ROW] = [28, 18];
  const colors = (chart, plot) => plot.series.map((_, i) => chart.series[i + 1].stroke(chart, i + 1));

  const drawing = (chart, plot) => {
    const style = getComputedStyle(root);
    const [ink, rule, panel] = ["--ink", "--rule", "--panel"].map((n) => style.getPropertyValue(n).trim());
    const escaped = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
    const text = (x, y, words, more = "") =>
      `<text x="${x}" y="${y}" fill="${ink}" ${more}>${escaped(words)}</text>`;
    const [left, top, wide, high] = ["left", "top", "width", "height"]
      .map((side) => chart.bbox[side] / devicePixelRatio);
    const at = (value, scale) => chart.valToPos(value, scale).toFixed(2);
    const line = (x1, y1, x2, y2, more) =>
      `<line x1="${x1}" y1="${y1}" x2="${x2}" y2="${y2}" ${more}/>`;
    const inside = [];
    const outside = [];
    for (const [axis, scale] of [[chart.axes[0], "x"], [chart.axes[1], "y"]]) {
      axis._splits.forEach((split, i) => {
        const [place, label] = [at(split, scale), axis._values[i] ?? ""];
        inside.push(scale === "x" ? line(place, 0, place, high, `stroke="${rule}"`)
          : line(0, place, wide, place, `stroke="${rule}"`));
        outside.push(scale === "x"
          ? text(left + Number(place), HEAD + top + high + 16, String(label), 'text-anchor="middle"')
          : text(left - 6, HEAD + top + Number(place) + 4, String(label), 'text-anchor="end"'));
      });
    }
    const stroke = colors(chart, plot);
    for (const { series, corners } of bands(plot, chart.data, () => true)) {
      const points = corners.map(([x, y]) => `${at(x, "x")},${at(y, "y")}`).join(" ");
      inside.push(`<polygon points="${points}" fill="${stroke[series]}" opacity="${OPACITY}"/>`);
    }
    plot.series.forEach((s, i) => {
      let [path, pen] = ["", "M"];
      chart.data[i + 1].forEach((y, row) => {
        if (y === undefined) return;
        if (y === null) { pen = "M"; return; }
        if (s.points) {
          const r = radius(s);
          path += `M${at(chart.data[0][row], "x")} ${at(y, "y")}m${-r} 0`
            + `a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`;
          return;
        }
        path += `${pen}${at(chart.data[0][row], "x")} ${at(y, "y")}`;
        pen = "L";
      });
      const dash = s.dashed && !s.points ? 'stroke-dasharray="7 5"' : "";
      const fill = s.points && !s.dashed ? stroke[i] : "none";
      inside.push(`<path d="${path}" fill="${fill}" stroke="${stroke[i]}" stroke-width="1.8" ${dash}/>`);
      const y = HEAD + chart.height + ROW * i + 12;
      outside.push(line(left, y - 4, left + 24, y - 4, `stroke="${stroke[i]}" stroke-width="3" ${dash}`),
        text(left + 32, y, s.name));
    });
    for (const { corners } of bands(plot, chart.data, (i) => hasEdges(chart, plot, plot.series[i]))) {
      for (const edge of [corners.slice(0, corners.length / 2), corners.slice(corners.length / 2)]) {
        const points = edge.map(([x, y]) => `${at(x, "x")},${at(y, "y")}`).join(" ");
        inside.push(`<polyline points="${points}" fill="none" stroke="${ink}"/>`);
      }
    }
    for (const { vertical, value, label } of plot.markers) {
      const place = at(value * (vertical ? plot.x : plot.y).factor, vertical ? "x" : "y");
      const dotted = `stroke="${ink}" stroke-dasharray="2 4"`;
      inside.push(vertical ? line(place, 0, place, high, dotted) : line(0, place, wide, place, dotted));
      outside.push(vertical ? text(left + Number(place), HEAD + top - 6, label, 'text-anchor="middle"')
        : text(left + wide - 4, HEAD + top + Number(place) - 4, label, 'text-anchor="end"'));
    }
    const all = HEAD + chart.height + ROW * plot.series.length;
    const middle = HEAD + top + high / 2;
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${chart.width}" height="${all}" `
      + `font-family="${FAMILY}" font-size="12"><rect width="100%" height="100%" fill="${panel}"/>`
      + text(8, 18, plot.title, 'font-size="14" font-weight="600"')
      + `<svg x="${left}" y="${HEAD + top}" width="${wide}" height="${high}">${inside.join("")}</svg>`
      + outside.join("") + text(left + wide / 2, HEAD + top + high + 34, named(plot.x), 'text-anchor="middle"')
      + text(12, middle, named(plot.y), `text-anchor="middle" transform="rotate(-90 12 ${middle})"`)
      + "</svg>\n";
  };

  const picture = (chart, plot) => {
    const source = chart.ctx.canvas;
    const canvas = document.createElement("canvas");
    const scale = devicePixelRatio;
    canvas.width = source.width;
    canvas.height = source.height + scale * (HEAD + ROW * plot.series.length);
    const ctx = canvas.getContext("2d");
    const style = getComputedStyle(root);
    ctx.fillStyle = style.getPropertyValue("--panel").trim();
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(source, 0, scale * HEAD);
    ctx.scale(scale, scale);
    ctx.fillStyle = style.getPropertyValue("--ink").trim();
    ctx.font = `600 14px ${FAMILY}`;
    ctx.fillText(plot.title, 8, 18);
    ctx.font = FONT;
    ctx.lineWidth = 3;
    colors(chart, plot).forEach((color, i) => {
      const y = HEAD + chart.height + ROW * i + 12;
      ctx.strokeStyle = color;
      ctx.setLineDash(plot.series[i].dashed ? [7, 5] : []);
      ctx.beginPath();
      ctx.moveTo(20, y - 4);
      ctx.lineTo(44, y - 4);
      ctx.stroke();
      ctx.fillText(plot.series[i].name, 52, y);
    });
    return new Promise((done) => canvas.toBlob(done, "image/png"));
  };

  // The file of a plot.
  const file = async (number, kind) => {
    const [chart, plot] = [charts[number], plots[number]];
    if (kind === "png") return picture(chart, plot);
    const [words, type] = kind === "csv" ? [table(chart, plot), "text/csv"]
      : [drawing(chart, plot), "image/svg+xml"];
    return new Blob([words], { type });
  };

  const button = (name, act) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = name;
    made.addEventListener("click", () => act(made));
    return made;
  };

  const save = async (number, kind) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await file(number, kind));
    link.download = `${plots[number].title.replace(/[^\p{L}\p{N}]+/gu, "-")}.${kind}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
  };

  document.querySelectorAll("[data-plot]").forEach((place) => {
    const row = document.createElement("div");
    row.className = "save";
    const kinds = ["svg", "png", "csv"];
    row.append("Save as ", ...kinds.map((kind) =>
      button(kind.toUpperCase(), () => save(Number(place.dataset.plot), kind))));
    place.parentElement.append(row);
  });

  // Some browsers refuse the clipboard to a page from a file: then the text is selected.
  const copy = async (pre, made) => {
    try {
      await navigator.clipboard.writeText(pre.textContent);
      made.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(pre);
    }
  };
  for (const pre of document.querySelectorAll("footer pre")) {
    pre.before(button("Copy", (made) => copy(pre, made)));
  }

  // A name in a legend hides its line, also by keyboard.
  const reachable = (chart) => {
    for (const name of chart.root.querySelectorAll(".u-series:not(:first-child) th")) {
      name.tabIndex = 0;
      name.setAttribute("role", "button");
      name.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        name.click();
      });
    }
  };

  const draw = () => {
    for (const chart of charts) chart.destroy();
    charts = [...document.querySelectorAll("[data-plot]")].map((place) => {
      const plot = plots[Number(place.dataset.plot)];
      return new uPlot(options(plot, place.clientWidth), joined(plot), place);
    });
    charts.forEach(reachable);
  };

  const fit = () => {
    for (const chart of charts) {
      const width = chart.root.parentElement.clientWidth;
      if (width !== chart.width) chart.setSize({ width, height: height(width) });
    }
  };

  draw();
  addEventListener("resize", fit);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  const printing = (on) => { root.classList.toggle("print", on); draw(); };
  addEventListener("beforeprint", () => printing(true));
  addEventListener("afterprint", () => printing(false));
  window.charts = () => charts;
  window.plotFile = file;
})();
