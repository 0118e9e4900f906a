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
      // uPlot's own numbers end at the third decimal.
      values: (u, ticks) => ticks.map((tick) => (tick == null ? "" : rounded(tick, 6))),
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
      series: [{ label: plot.x.label, value: (u, v) => shown(v, plot.x.unit) },
        ...plot.series.map((s) => ({
          label: s.name, stroke: lineColor, width: 1.8, dash: s.dashed ? [7, 5] : undefined,
          spanGaps: false, points: { show: false }, value: (u, v) => shown(v, plot.y.unit),
        }))],
      cursor: {
        drag: { x: true, y: false, setScale: true }, focus: { prox: 24 },
        sync: plot.sync ? { key: plot.sync, setSeries: false } : undefined,
      },
      legend: { markers: {
        stroke: lineColor, width: 3,
        dash: (u, line) => (plot.series[line - 1]?.dashed ? "dashed" : "solid"),
      } },
      hooks: { draw: [markers(plot, color)] },
    };
  };

  const draw = () => {
    for (const chart of charts) chart.destroy();
    charts = [...document.querySelectorAll("[data-plot]")].map((place) => {
      const plot = plots[Number(place.dataset.plot)];
      return new uPlot(options(plot, place.clientWidth), joined(plot), place);
    });
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
})();
