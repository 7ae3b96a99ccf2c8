// What is wrong with the layout of a page: content wider than the window, and text over other text.
(() => {
  const faults = [];
  const wide = document.documentElement.scrollWidth - window.innerWidth;
  if (wide > 1) faults.push(`the page is ${wide} px wider than the window`);

  // the part of an element that its scrolling or hidden ancestors let through
  const visible = (box, element) => {
    let { left, top, right, bottom } = box;
    for (let at = element; at && at !== document.body; at = at.parentElement) {
      const style = getComputedStyle(at);
      if (style.overflowX !== "visible" || style.overflowY !== "visible" || at.tagName === "svg") {
        const outer = at.getBoundingClientRect();
        left = Math.max(left, outer.left); top = Math.max(top, outer.top);
        right = Math.min(right, outer.right); bottom = Math.min(bottom, outer.bottom);
      }
      if (style.position === "fixed" || style.position === "sticky") return null; // over the page on purpose
    }
    return right - left > 1 && bottom - top > 1 ? { left, top, right, bottom } : null;
  };

  const bounds = (corners) => {
    const xs = corners.map((each) => each.x), ys = corners.map((each) => each.y);
    return { left: Math.min(...xs), right: Math.max(...xs), top: Math.min(...ys), bottom: Math.max(...ys) };
  };
  // how deep two oriented boxes are in each other along an axis of either, over the height of the lower one
  const depth = (a, b) => {
    const sides = [a, b].flatMap(({ corners }) => [[corners[0], corners[1]], [corners[0], corners[3]]]);
    const overlaps = sides.map(([from, to]) => {
      const length = Math.hypot(to.x - from.x, to.y - from.y) || 1;
      const along = ({ x, y }) => (x * (to.x - from.x) + y * (to.y - from.y)) / length;
      const one = a.corners.map(along), other = b.corners.map(along);
      return Math.min(Math.max(...one), Math.max(...other)) - Math.max(Math.min(...one), Math.min(...other));
    });
    return Math.min(...overlaps);
  };
  const height = ({ corners }) => Math.hypot(corners[3].x - corners[0].x, corners[3].y - corners[0].y);

  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, parent = node.parentElement;
    if (!node.textContent.trim() || !parent.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (parent.closest("script, style, noscript, option, dialog:not([open])")) continue;
    const rotated = parent.closest("svg text"), matrix = rotated && rotated.getScreenCTM();
    if (rotated && Math.abs(matrix.a * matrix.b) > 1e-6) { // neither level nor upright: an oriented box, once
      if (texts.some((each) => each.parent === rotated)) continue;
      const box = rotated.getBBox();
      const corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(([x, y]) =>
        new DOMPoint(box.x + x * box.width, box.y + y * box.height).matrixTransform(matrix));
      if (!visible(rotated.getBoundingClientRect(), rotated)) continue;
      texts.push({ ...bounds(corners), corners, parent: rotated, text: rotated.textContent.trim().slice(0, 40) });
      continue;
    }
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) {
      const inside = visible(box, parent);
      if (!inside) continue;
      const { left, top, right, bottom } = inside;
      const corners = [[left, top], [right, top], [right, bottom], [left, bottom]].map(([x, y]) => ({ x, y }));
      texts.push({ ...inside, corners, parent, text: node.textContent.trim().slice(0, 40) });
    }
  }
  texts.sort((a, b) => a.top - b.top);
  for (let i = 0; i < texts.length; i++) {
    const a = texts[i];
    for (let j = i + 1; j < texts.length && texts[j].top < a.bottom; j++) {
      const b = texts[j];
      if (a.parent === b.parent || a.parent.contains(b.parent) || b.parent.contains(a.parent)) continue;
      if (Math.min(a.right, b.right) - Math.max(a.left, b.left) <= 2) continue;
      // lines of text have leading: a third of the lower one may overlap
      const deep = depth(a, b);
      if (deep > Math.max(2, 0.35 * Math.min(height(a), height(b))))
        faults.push(`“${a.text}” and “${b.text}” overlap by ${deep.toFixed(0)} px`);
    }
  }
  for (const text of document.querySelectorAll("svg.chart text")) {
    const box = text.getBoundingClientRect(), chart = text.closest("svg").getBoundingClientRect();
    if (box.width && (box.left < chart.left - 1 || box.right > chart.right + 1))
      faults.push(`“${text.textContent.trim()}” is cut by its chart`);
  }
  // tables that a command printed: their rule is one line, or the columns are torn apart
  const pen = document.createElement("canvas").getContext("2d");
  for (const block of document.querySelectorAll(".output pre")) {
    const style = getComputedStyle(block);
    pen.font = style.font;
    const room = block.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const rule = block.textContent.split("\n").find((line) => line.includes("───"));
    if (rule && pen.measureText(rule.trimEnd()).width > room + 1)
      faults.push(`a printed table of ${rule.length} letters is wrapped`);
  }
  return faults.slice(0, 12);
})()
