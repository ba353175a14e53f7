-- Where a person finds the page of a rig; NULL if nobody has said it.
ALTER TABLE hub.bench ADD COLUMN page text;
