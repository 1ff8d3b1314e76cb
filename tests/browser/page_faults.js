() => {
  const found = [];
  const width = document.documentElement.clientWidth;
  const named = (item) => `${item.tagName}${item.id && "#" + item.id} ${item.textContent.trim().slice(0, 40)}`;
  const scrolls = (item) => item.closest(".scroll, .equation, .contents, pre");
  const seen = [...document.body.querySelectorAll("*")].filter((item) => item.checkVisibility());
  if (document.documentElement.scrollWidth > width) found.push(`the page is ${document.documentElement.scrollWidth} wide`);
  for (const item of seen) {
    const style = getComputedStyle(item);
    if (item.getBoundingClientRect().right > width + 1 && !scrolls(item)) found.push(`beyond the edge: ${named(item)}`);
    const cuts = style.overflowX === "hidden" || style.overflowX === "clip";
    const longer = item.scrollWidth > item.clientWidth + 1 && item.clientWidth > 1 && item.textContent.trim();
    const matters = cuts && !item.matches("[aria-hidden=true] *, select");
    if (longer && (matters || item.matches(".card .scroll"))) found.push(`cut off: ${named(item)}`);
  }
  const clicked = "a[href], button:enabled, input:enabled, select, summary";
  for (const item of seen.filter((item) => item.matches(clicked))) {
    item.scrollIntoView({ block: "center", inline: "center", behavior: "instant" });
    const box = item.getClientRects()[0];
    const above = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    const free = above && (item.contains(above) || above.contains(item));
    if (!free) found.push(`${named(item)} lies under ${above ? named(above) : "the edge"}`);
  }
  scrollTo(0, 0);
  return found;
}
