// Figures 2 to 6, with linear or logarithmic axes, and a legend of buttons that show and hide a line in all of them.
"use strict";

(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const panels = [["total", "total, ms"], ["update", "update, ms"], ["broad_phase", "broad phase, ms"], ["pairs", "pairs"]];
  const hidden = new Set();
  const figures = [];
  const narrow = window.matchMedia("(max-width: 760px)");
  const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function element(parent, tag, properties = {}) {
    const made = Object.assign(document.createElement(tag), properties);
    parent.append(made);
    return made;
  }

  // A row of buttons, one of which is pressed.
  function segments(parent, name, choices, chosen, choose) {
    const group = element(parent, "span", { className: "segments" });
    group.setAttribute("role", "group");
    group.setAttribute("aria-label", name);
    const press = (value) => {
      for (const button of group.children) button.setAttribute("aria-pressed", String(button.value === value));
    };
    for (const [value, text] of choices) {
      const button = element(group, "button", { type: "button", value, textContent: text });
      button.addEventListener("click", () => { press(value); choose(value); });
    }
    press(chosen);
  }

  function select(parent, name, choices, chosen, choose) {
    const label = element(parent, "label", { textContent: name + " " });
    const made = element(label, "select");
    for (const [value, text] of choices) element(made, "option", { value, textContent: text, selected: value === chosen });
    made.addEventListener("change", () => choose(made.value));
  }

  function swatch(series) {
    const dash = { dot: "2 3", dash: "5 3", dashdot: "5 2 1 2", longdash: "8 3" }[series.dash] || "none";
    return `<svg width="22" height="8" aria-hidden="true"><line x1="0" y1="4" x2="22" y2="4" stroke="${series.colour}"` +
      ` stroke-width="2.5" stroke-dasharray="${dash}"/></svg>`;
  }

  function legend(parent) {
    const row = element(parent, "div", { className: "legend" });
    row.setAttribute("role", "group");
    row.setAttribute("aria-label", "Show or hide");
    for (const series of data.series) {
      const button = element(row, "button", { type: "button", innerHTML: swatch(series) });
      button.dataset.series = series.label;
      button.append(series.label);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        if (!hidden.delete(series.label)) hidden.add(series.label);
        for (const each of document.querySelectorAll(".legend button")) {
          each.setAttribute("aria-pressed", String(!hidden.has(each.dataset.series)));
        }
        figures.forEach(draw);
      });
    }
  }

  function axis(extra) {
    const colours = { gridcolor: variable("--grid"), linecolor: variable("--line"), tickcolor: variable("--line") };
    return { ...colours, zeroline: false, automargin: true, fixedrange: false, ...extra };
  }

  function line(series, xaxis, yaxis, x, y, unit) {
    const style = { color: series.colour, dash: series.dash, width: 1.6 };
    return {
      type: "scatter", name: series.label, x, y, xaxis, yaxis, line: style, showlegend: false,
      visible: !hidden.has(series.label), hovertemplate: `%{y:,.4~g} ${unit}`,
    };
  }

  function decades(values) {
    const [least, most] = values.filter((y) => y > 0).reduce(([a, b], y) => [Math.min(a, y), Math.max(b, y)], [Infinity, 0]);
    return Math.log10(most / least);
  }

  // Rows and columns of panels, each with axes and a title.
  function grid(count, columns, titles, scale, values, xaxis) {
    const rows = Math.ceil(count / columns);
    const gap = { x: columns > 1 ? 0.09 : 0, y: (narrow.matches ? 0.24 : 0.2) / rows };
    const size = { x: (1 - gap.x * (columns - 1)) / columns, y: (1 - gap.y * (rows - 1)) / rows };
    const layout = { annotations: [] };
    for (let k = 0; k < count; ++k) {
      const number = k === 0 ? "" : String(k + 1);
      const left = (k % columns) * (size.x + gap.x);
      const top = 1 - Math.floor(k / columns) * (size.y + gap.y);
      const span = decades(values(k));
      const dtick = span > 2.2 ? 1 : span > 0.6 ? "D2" : undefined;  // a short axis gets ticks like a linear one
      const type = scale === "log" ? { type: "log", dtick } : { rangemode: "tozero" };
      layout["xaxis" + number] = axis({ ...xaxis(k), domain: [left, left + size.x], anchor: "y" + number });
      layout["yaxis" + number] =
        axis({ ...type, tickformat: ",~g", nticks: 6, domain: [Math.max(0, top - size.y), top], anchor: "x" + number });
      layout.annotations.push({
        text: titles[k], xref: "paper", yref: "paper", x: left, y: top, xanchor: "left", yanchor: "bottom",
        showarrow: false, font: { size: 13.5, color: variable("--text") }, yshift: 3,
      });
    }
    return layout;
  }

  function overObjects(figure) {
    const scenarios = Object.keys(data.totals);
    const traces = [];
    scenarios.forEach((scenario, k) => {
      const number = k === 0 ? "" : String(k + 1);
      data.totals[scenario][figure.metric].forEach((one, s) => {
        if (one.x.length === 0) return;
        const trace = line(data.series[s], "x" + number, "y" + number, one.x, one.y, "s");
        trace.mode = "lines+markers";
        trace.marker = { symbol: data.series[s].marker, size: 8, color: data.series[s].colour };
        trace.error_y = { type: "data", symmetric: false, array: one.more, arrayminus: one.less, thickness: 1, width: 2 };
        traces.push(trace);
      });
    });
    const columns = narrow.matches ? 1 : 2;
    const sizes = (k) => [...new Set(data.totals[scenarios[k]].total.flatMap((one) => one.x))];
    const titles = scenarios.map((scenario) => `<b>${scenario}</b>, s`);
    const values = (k) => data.totals[scenarios[k]][figure.metric].flatMap((one) => one.y);
    const layout = grid(scenarios.length, columns, titles, figure.scale, values,
      (k) => ({
      tickvals: sizes(k), tickformat: ",d", hoverformat: ",d",
      title: k + columns < scenarios.length ? undefined : { text: "objects", standoff: 6 },
    }));
    const rows = Math.ceil(scenarios.length / columns);
    return { traces, layout, height: rows * (narrow.matches ? 260 : 310) + 70 };
  }

  function overFrames(figure) {
    const lines = data.frames[figure.scenario][figure.objects];
    const traces = [];
    let frames = 0;
    panels.forEach(([column], k) => {
      const number = k === 0 ? "" : String(k + 1);
      for (const series of data.series) {
        if (!(series.label in lines)) continue;
        const y = lines[series.label][column];
        frames = y.length;
        const trace = line(series, "x" + number, "y" + number, y.map((_, f) => f), y, column === "pairs" ? "pairs" : "ms");
        trace.mode = "lines";
        trace.line.width = 1.3;
        traces.push(trace);
      }
    });
    const values = (k) => Object.values(lines).flatMap((columns) => columns[panels[k][0]]);
    const isLast = (k) => k === panels.length - 1;
    const layout = grid(panels.length, 1, panels.map(([, title]) => `<b>${title}</b>`), figure.scale, values, (k) => ({
      matches: k > 0 ? "x" : undefined, range: [0, frames - 1], showticklabels: isLast(k), hoverformat: "d",
      title: isLast(k) ? { text: "frame", standoff: 6 } : undefined,
    }));
    return { traces, layout, height: panels.length * (narrow.matches ? 190 : 205) + 70 };
  }

  function draw(figure) {
    const { traces, layout, height } = figure.kind === "objects" ? overObjects(figure) : overFrames(figure);
    Object.assign(layout, {
      height, margin: { l: narrow.matches ? 46 : 56, r: 12, t: 28, b: 44 }, hovermode: "x unified", hoverdistance: -1,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12.5, color: variable("--soft") },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: variable("--soft"), activecolor: variable("--text") },
      hoverlabel: { bgcolor: variable("--ground"), bordercolor: variable("--line"), font: { color: variable("--text") } },
    });
    return Plotly.react(figure.plot, traces, layout, {
      responsive: true, displaylogo: false, displayModeBar: narrow.matches ? false : "hover", modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { filename: figure.id, format: "svg" },
    });
  }

  function set(figure, property) {
    return (value) => { figure[property] = value; draw(figure); };
  }

  for (const parent of document.querySelectorAll("figure.chart")) {
    const figure = { id: parent.id, kind: parent.dataset.kind, scenario: parent.dataset.scenario, scale: "log", metric: "total" };
    const controls = element(parent, "div", { className: "controls" });
    if (figure.kind === "objects") {
      select(controls, "Time", Object.entries(data.compared), figure.metric, set(figure, "metric"));
    } else {
      figure.objects = String(data.shown[figure.scenario]);
      const sizes = Object.keys(data.frames[figure.scenario]).map((n) => [n, Number(n).toLocaleString("en")]);
      select(controls, "Objects", sizes, figure.objects, set(figure, "objects"));
    }
    segments(controls, "Axis", [["log", "Logarithmic"], ["linear", "Linear"]], figure.scale, set(figure, "scale"));
    legend(parent);
    figure.plot = element(parent, "div", { className: "plot" });
    figures.push(figure);
    setTimeout(() => draw(figure));  // one at a time, so that the page stays responsive
  }
  document.addEventListener("themechange", () => figures.forEach(draw));
  narrow.addEventListener("change", () => figures.forEach(draw));
  window.broadclSegments = segments;
})();
