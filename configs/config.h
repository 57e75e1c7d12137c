/* config.h: what reading and asking share. Internal to configs/. */
#ifndef LF_CONFIGS_CONFIG_H
#define LF_CONFIGS_CONFIG_H

#include "configs/configs.h"
#include "configs/schema.h"

struct lf_config {
    lf_value *value; /* [lf_schema_size] */
};

/* All defaults. */
lf_config *lf_config_defaults(void);

/* One key from text; the message has the key, but no file and line. */
lf_status lf_config_assign(lf_config *cfg, const char *key, const char *text, lf_error *err);

#endif
