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

  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, parent = node.parentElement;
    if (!node.textContent.trim() || !parent.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (parent.closest("script, style, noscript, option, dialog:not([open])")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) {
      const inside = visible(box, parent);
      if (inside) texts.push({ ...inside, parent, text: node.textContent.trim().slice(0, 40) });
    }
  }
  texts.sort((a, b) => a.top - b.top);
  for (let i = 0; i < texts.length; i++) {
    const a = texts[i];
    for (let j = i + 1; j < texts.length && texts[j].top < a.bottom; j++) {
      const b = texts[j];
      if (a.parent === b.parent || a.parent.contains(b.parent) || b.parent.contains(a.parent)) continue;
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      // lines of text have leading: a third of the lower one may overlap
      if (across > 2 && down > 0.35 * Math.min(a.bottom - a.top, b.bottom - b.top))
        faults.push(`“${a.text}” and “${b.text}” overlap by ${across.toFixed(0)} × ${down.toFixed(0)} px`);
    }
  }
  return faults.slice(0, 12);
})()
