% The readings of one sweep of a run, with Octave; MATLAB has readtable for the same file.
%
% Usage: octave load.m FOLDER

folder = argv(){1};
file = fopen(fullfile(folder, "readings.csv"));
header = strsplit(fgetl(file), ",");
% Text is in quotes and has no line breaks; a missing number is NaN.
is_text = ismember(header, {"purpose", "step", "flag", "fit_timing", "is_used", ...
                            "fit_always_loss", "is_simulated"});
formats = repmat({"%f"}, 1, numel(header));
formats(is_text) = {"%q"};
cells = textscan(file, strjoin(formats, " "), "Delimiter", ",");
fclose(file);

column = @(name) cells{strcmp(header, name)};
is_first = column("sweep") == 1;
frequency_hz = column("frequency_hz")(is_first);
impedance_ohm = column("resistance_ohm")(is_first) + 1i * column("reactance_ohm")(is_first);
conductance_s = real(1 ./ impedance_ohm);
[peak_s, at] = max(conductance_s);
printf("sweep 1: %d readings, largest conductance %.3g S at %.2f Hz\n", ...
       numel(frequency_hz), peak_s, frequency_hz(at));
