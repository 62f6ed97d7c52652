"""Objects from English text, offline: grammar, vocabulary and builders."""
