// Icons, drawn in the colour of the text beside them. Words stand beside every one of them.
const paths = {
  play: <path d="M8 5v14l11-7z" fill="currentColor" />,
  pause: <path d="M7 5h3v14H7zM14 5h3v14h-3z" fill="currentColor" />,
  alert: <><circle cx="12" cy="12" r="9.5" /><path d="M12 6.5v7" /><path d="M12 17v.5" /></>,
  check: <><circle cx="12" cy="12" r="9.5" /><path d="m7.5 12.5 3 3 6-6.5" /></>,
  tick: <path d="m5 12.5 4.5 4.5L19 7" />,
  cross: <path d="m6 6 12 12M18 6 6 18" />,
  stop: <><path d="M8 2.5h8L21.5 8v8L16 21.5H8L2.5 16V8z" /><path d="M8 12h8" /></>,
  fault: <><path d="M8 2.5h8L21.5 8v8L16 21.5H8L2.5 16V8z" fill="currentColor" /><path d="M12 6.5v7M12 17v.5" class="hole" /></>,
  up: <path d="M12 20V5m-6 6 6-6 6 6" />,
  down: <path d="M12 4v15m-6-6 6 6 6-6" />,
  abort: <path d="M12 21V8m-5 5 5-5 5 5M5 4h14" />,
  hand: <path d="M7 12V6.5a1.5 1.5 0 0 1 3 0V11 4.5a1.5 1.5 0 0 1 3 0V11 5.5a1.5 1.5 0 0 1 3 0V12 8.5a1.5 1.5 0 0 1 3 0V15c0 4-2.5 6.5-6 6.5-3 0-4.5-1.5-6-4l-2.5-4a1.5 1.5 0 0 1 2.5-1.700z" fill="currentColor" stroke="none" />,
  turnLeft: <path d="M4 5v6h6M4.5 11a8 8 0 1 1-.4 3" />,
  turnRight: <path d="M20 5v6h-6m5.5 0a8 8 0 1 0 .4 3" />,
  now: <path d="M2 12h4l3-7 5 14 3-7h5" />,
  runs: <path d="M4 6h16M4 12h16M4 18h10" />,
  rig: <path d="M5 21V3h9v6m0 0v5m-4 0h8v4h-8zM3 21h6" />,
  list: <path d="M5 4h14v16H5zM8 9h8M8 13h8M8 17h5" />,
};

export type IconName = keyof typeof paths;

export function Icon({ name, size = 20 }: { name: IconName; size?: number }) {
  return (
    <svg class="icon" width={size} height={size} viewBox="0 0 24 24" fill="none" stroke="currentColor"
      stroke-width="2" stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">
      {paths[name]}
    </svg>
  );
}

/** The probe over, in or somewhere about a sample. */
export function ProbeIcon({ probe }: { probe: "clear" | "in contact" | "unknown" }) {
  const y = probe === "clear" ? 14 : 24;
  const isUnknown = probe === "unknown";
  return (
    <svg class="icon" width="34" height="34" viewBox="0 0 36 36" fill="none" stroke="currentColor"
      stroke-width="2.5" stroke-dasharray={isUnknown ? "3 3" : undefined} aria-hidden="true">
      <path d={`M18 2V${y - 5}`} />
      <circle cx="18" cy={y} r="5" fill={isUnknown ? "none" : "currentColor"} />
      <path d={probe === "clear" ? "M3 33h30" : "M3 24h9m12 0h9"} />
    </svg>
  );
}

/** The shape of a sample: colour is never alone. */
export function shape(index: number, x: number, y: number, r = 4.5): string {
  switch (index % 5) {
    case 0: return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;
    case 1: return `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`;
    case 2: return `M${x} ${y - r * 1.15}L${x + r * 1.15} ${y + r}H${x - r * 1.15}z`;
    case 3: return `M${x} ${y - r * 1.35}L${x + r * 1.35} ${y}L${x} ${y + r * 1.35}L${x - r * 1.35} ${y}z`;
    default: return `M${x} ${y + r * 1.15}L${x + r * 1.15} ${y - r}H${x - r * 1.15}z`;
  }
}

export function SampleMark({ index }: { index: number }) {
  return <svg class={`icon s${index % 5}`} width="14" height="14" viewBox="0 0 14 14" aria-hidden="true"><path d={shape(index, 7, 7, 5)} fill="currentColor" /></svg>;
}
